# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from bitneat.champion import Champion, FloatChampion, load, save_json, save_pickle
from bitneat.cli.main import main
from bitneat.controller import DiscreteAction
from bitneat.controller.packing import pack
from bitneat.network import FloatNetwork, FloatNode
from bitneat.verify.size import packed_bits

ROOT = Path(__file__).resolve().parents[2]
TINY, WALKER = (ROOT / "examples" / "champions" / f"{name}.pkl" for name in ("tiny", "walker"))
HISTORY = ROOT / "examples" / "walker" / "history.csv"
HEAD = "generation,best,mean,selection,steps\n"


def texts(path: Path) -> list[str]:
    """What an SVG says: Matplotlib leaves each text as a comment beside its outlines."""
    return re.findall(r"<!-- (.*?) -->", path.read_text())


@pytest.mark.parametrize(("name", "magic"), [("a.svg", b"<?xml"), ("A.PNG", b"\x89PNG")])
def test_activations_are_drawn_in_the_format_that_the_name_says(
    name: str, magic: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    assert main(["plot", "activations", "-o", str(path), "--frac-bits", "4"]) == 0
    assert path.read_bytes().startswith(magic)
    assert capsys.readouterr().out == f"wrote {path}\n"


@pytest.mark.parametrize("name", ["activations", "a.pdf", "svg"])
def test_another_format_is_refused(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / name
    assert main(["plot", "activations", "-o", str(path)]) == 2
    assert capsys.readouterr().err == f"bitneat: {path}: expected a name that ends in .svg or .png\n"
    assert not path.exists()


@pytest.mark.parametrize("value", ["3", "13", "x"])
def test_frac_bits_are_checked(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plot", "activations", "-o", "a.svg", "--frac-bits", value]) == 2
    assert "4..12" in capsys.readouterr().err


def test_without_matplotlib_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["plot", "activations", "-o", str(tmp_path / "a.svg")]) == 2
    assert capsys.readouterr().err == "bitneat: plot: Matplotlib is not installed; pip install 'bitneat[plot]'\n"


def test_a_folder_that_is_not_there_is_an_error_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "missing" / "a.svg"
    assert main(["plot", "activations", "-o", str(path)]) == 2
    assert capsys.readouterr().err == f"bitneat: {path}: cannot write: No such file or directory\n"


def test_the_settings_of_the_user_make_no_difference(tmp_path: Path) -> None:
    rc = tmp_path / "matplotlibrc"
    rc.write_text("font.size: 30\nlines.linewidth: 9\nsvg.fonttype: none\nbackend: nowhere\n", encoding="ascii")
    contents = set()
    for number, extra in enumerate(({}, {"MATPLOTLIBRC": str(rc), "TZ": "Asia/Tokyo", "LANG": "C"})):
        path = tmp_path / f"{number}.svg"
        command = [sys.executable, "-m", "bitneat", "plot", "activations", "-o", str(path)]
        subprocess.run(command, check=True, env=os.environ | extra, capture_output=True)
        contents.add(path.read_bytes())
    assert len(contents) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["fitness", str(HISTORY), "--x", "steps"],
        ["network", str(TINY)],
        ["pareto", str(TINY), str(WALKER)],
        ["size", str(TINY), "--targets", "host-unrolled,host-table"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_the_same_figure_is_the_same_file(arguments: list[str], tmp_path: Path) -> None:
    for suffix in ("svg", "png"):
        paths = [tmp_path / f"{number}.{suffix}" for number in range(2)]
        for path in paths:
            assert main(["plot", *arguments, "-o", str(path)]) == 0
        assert paths[0].read_bytes() == paths[1].read_bytes()


def test_names_that_are_no_utf_8_are_shown_escaped(tmp_path: Path) -> None:
    runs = [tmp_path / os.fsdecode(name) for name in (b"run\xfe", b"run\xff")]
    for run in runs:
        run.mkdir()
        (run / "history.csv").write_text(HEAD + "0,1,1,1,100\n1,2,2,2,100\n")
    for number, labels in enumerate(([], ["--label", "l\udcfe", "--label", "m"])):
        path = tmp_path / f"{number}.svg"
        assert main(["plot", "fitness", *map(str, runs), "-o", str(path), *labels]) == 0
        assert any(r"\udcfe" in text for text in texts(path))


def test_runs_of_one_label_are_pooled_and_the_solved_line_is_that_of_the_environment(tmp_path: Path) -> None:
    for name, values in (("a", (1, 2, 9)), ("b", (3, 4, 5)), ("c", (5, 9, 7, 99))):
        rows = "".join(f"{i},{v},{v},{v},100\n" for i, v in enumerate(values))
        (tmp_path / name).mkdir()
        (tmp_path / name / "history.csv").write_text(HEAD + rows)
    runs = [str(tmp_path / name) for name in "abc"]
    path = tmp_path / "f.svg"
    labels = ["--label", "ours", "--label", "ours", "--label", "theirs"]
    assert main(["plot", "fitness", *runs, *labels, "--reference", "42", "--curve", "best", "-o", str(path)]) == 0
    shown = texts(path)
    assert "ours (2 runs)" in shown
    assert "theirs" in shown
    assert "42" in shown

    from bitneat.report.fitness import pooled, read_history

    histories = [read_history(Path(run), "x") for run in runs]
    x, values = pooled(histories, "best", by_steps=False)
    assert x.tolist() == [0, 1, 2]
    assert values.tolist() == [[1, 2, 9], [3, 4, 5], [5, 9, 7]]
    x, values = pooled(histories, "best", by_steps=True)
    assert (x[0], x[-1]) == pytest.approx((100e-6, 300e-6))
    assert values[:, 0].tolist() == [1, 3, 5]
    assert values[:, -1].tolist() == pytest.approx([9, 5, 7])


def test_a_run_folder_names_its_environment_whose_threshold_is_drawn(tmp_path: Path) -> None:
    (tmp_path / "tiny.ini").write_text(
        "[evolve]\nmax_steps = 20\nreport_episodes = 1\nselection_episodes = 1\nfinal_episodes = 1\n[NEAT]\npop_size = 4\n"
    )
    run = str(tmp_path / "run")
    arguments = ["--config", str(tmp_path / "tiny.ini"), "--generations", "2", "--workers", "1", "-o", run]
    assert main(["evolve", "--env", "CartPole-v1", *arguments]) == 0
    path = tmp_path / "f.svg"
    assert main(["plot", "fitness", run, "-o", str(path)]) == 0
    assert "475" in texts(path)
    assert "best so far, selection seeds" in texts(path)
    assert main(["plot", "pareto", run, "-o", str(path)]) == 0
    assert any(text.startswith("run: ") for text in texts(path))


def test_pareto_draws_the_front_and_says_what_it_leaves_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tiny, walker = load(TINY), load(WALKER)
    worse = Champion(walker.controller, walker.action, walker.environment, {"held_out": {"mean": 1.0, "std": 2.0}})
    unscored = Champion(tiny.controller, tiny.action, tiny.environment, {})
    network = FloatNetwork(1, (FloatNode(((0, 1.0),)),), (1,))
    for name, champion in (("a", tiny), ("b", worse)):
        (tmp_path / "runs" / name).mkdir(parents=True)
        save_pickle(champion, tmp_path / "runs" / name / "champion.pkl")
        save_json(champion, tmp_path / "runs" / name / "champion.json")
    save_pickle(unscored, tmp_path / "runs" / "unscored.pkl")
    save_json(FloatChampion(network, DiscreteAction(1), None, {}), tmp_path / "runs" / "float.json")
    (tmp_path / "runs" / "other.json").write_text("{}")
    path = tmp_path / "p.svg"
    assert main(["plot", "pareto", str(tmp_path / "runs"), "-o", str(path)]) == 0
    errors = capsys.readouterr().err
    assert "float.json: float weights have no packed form" in errors
    assert "unscored.pkl: has no held-out score" in errors
    shown = texts(path)
    assert f"a: {len(pack(tiny.controller))} bytes" in shown
    assert f"b: {len(pack(walker.controller))} bytes" in shown
    assert "300" in shown

    from bitneat.report.pareto import collect, front

    points = collect([tmp_path / "runs"]).points
    assert sorted(point.name for point in points) == ["a", "b"]  # each controller once
    assert [point.name for point in front(points)] == ["a"]
    assert [point.name for point in front(collect([TINY, WALKER]).points)] == ["tiny", "walker"]


def test_pareto_draws_one_environment_and_says_which_others_there_were(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = ROOT / "examples" / "champions"
    assert main(["plot", "pareto", str(folder), "-o", str(tmp_path / "walkers.svg")]) == 0
    assert "left out: 1 champion for CartPole-v1\n" in capsys.readouterr().err
    assert "cartpole" not in (tmp_path / "walkers.svg").read_text()
    command = ["plot", "pareto", str(folder), "--env", "CartPole-v1", "-o", str(tmp_path / "pole.svg")]
    assert main(command) == 0
    assert "BipedalWalker-v3" in capsys.readouterr().err
    assert main([*command[:-1], str(tmp_path / "none.svg"), "--env", "Taxi-v3"]) == 2
    assert "--env Taxi-v3: found no champion for it, only for Acrobot-v1, " in capsys.readouterr().err


def test_pareto_reads_the_results_of_a_reproduction(tmp_path: Path) -> None:
    path = tmp_path / "p.svg"
    assert main(["plot", "pareto", str(ROOT / "docs" / "paper" / "results"), "-o", str(path)]) == 0
    result = json.loads((ROOT / "docs" / "paper" / "results" / "bit-gains-1.json").read_text())
    assert f"bit-gains-1: {result['packed_bytes']} bytes" in texts(path)


def test_size_shows_every_encoding_and_what_the_c_takes(tmp_path: Path) -> None:
    path = tmp_path / "s.svg"
    out = tmp_path / "size.json"
    assert main(["plot", "size", str(TINY), "--targets", "host-unrolled,host-table", "-o", str(path)]) == 0
    assert main(["size", str(TINY), "--targets", "host-unrolled,host-table", "--json", str(out)]) == 0
    shown = [text.strip() for text in texts(path)]
    for bits in packed_bits(load(TINY).controller):
        assert bits.encoding in shown
        assert str(bits.num_bytes) in shown
    targets = json.loads(out.read_text())["targets"]
    assert {f"host, {target['style']}" for target in targets} <= set(shown)
    assert {str(target["flash_bytes"]) for target in targets} <= set(shown)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "bitneat: the following arguments are required: FIGURE"),
        (["nothing"], "nothing"),
        (["network", "none.pkl", "-o", "a.svg"], "bitneat: none.pkl: cannot read: No such file or directory"),
        (["network", "champion.pkl"], "required: -o/--output"),
        (["fitness", "-o", "a.svg"], "required: RUN"),
        (["fitness", ".", "-o", "a.svg"], "bitneat: .: holds no history.csv; expected a run folder of bitneat evolve"),
        (
            ["fitness", "polish.csv", "-o", "a.svg"],
            "polish.csv: expected a history of bitneat evolve; it has no column 'mean'",
        ),
        (["fitness", "empty.csv", "-o", "a.svg"], "bitneat: empty.csv: holds no generation yet"),
        (["fitness", "text.csv", "-o", "a.svg"], "bitneat: text.csv: damaged: expected a number in each column"),
        (["fitness", "short.csv", "-o", "a.svg"], "bitneat: short.csv: damaged: expected a number in each column"),
        (["fitness", "nan.csv", "-o", "a.svg"], "bitneat: nan.csv: damaged: a number is not finite"),
        (
            ["fitness", "a", "b", "--label", "x", "-o", "a.svg"],
            "--label: expected one for each of 2 runs, or none, got 1",
        ),
        (
            ["fitness", "good.csv", "--reference", "nan", "-o", "a.svg"],
            "--reference nan: expected a reward in -1e+100..1e+100",
        ),
        (["fitness", "good.csv", "--reference", "1e308", "-o", "a.svg"], "--reference 1e+308: expected a reward in"),
        (["pareto", ".", "-o", "a.svg"], "plot pareto: found no champion with packed bytes and a held-out score"),
        (["pareto", "text.csv", "-o", "a.svg"], "bitneat: text.csv: not a champion"),
        (["size", "text.csv", "-o", "a.svg"], "bitneat: text.csv: not a champion"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("polish.csv").write_text("generation,best,selection,steps\n")
    Path("empty.csv").write_text(HEAD)
    Path("good.csv").write_text(HEAD + "0,1,1,1,1\n")
    Path("text.csv").write_text(HEAD + "0,1,x,1,1\n")
    Path("short.csv").write_text(HEAD + "0,1\n")
    Path("nan.csv").write_text(HEAD + "0,1,nan,1,1\n")
    assert main(["plot", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not Path("a.svg").exists()
