# SPDX-License-Identifier: MIT
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bitneat.champion import EnvironmentSpec, save_pickle
from bitneat.cli.main import main
from bitneat.verify import check
from bitneat.verify.targets import select
from tests.verify.champions import champion, plain_champion, written

HOST = ["--targets", "host-unrolled,host-table"]
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a champion in it; episodes are cut short."""
    monkeypatch.chdir(tmp_path)
    save_pickle(plain_champion(), tmp_path / "champion.pkl")
    whole = check.closed_loop
    monkeypatch.setattr(check, "closed_loop", lambda *args, **options: whole(*args, **{**options, "max_steps": 25}))
    return tmp_path


@pytest.fixture
def run(folder: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run ``bitneat verify``: its status, output and errors."""

    def call(*arguments: str) -> tuple[int, str, str]:
        capsys.readouterr()
        status = main(["verify", *arguments])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return call


def test_without_arguments_the_c_beside_the_champion_is_found_and_named(run: Run, folder: Path) -> None:
    written(plain_champion(), folder, stem="walker")
    status, out, err = run()
    assert status == 0
    assert "checking walker.c (style unrolled) against champion.pkl\n" in out
    chips = ", ".join(ready.target.name for ready in select(None) if ready.runs and not ready.target.loads_on_host)
    assert out.splitlines()[-1] == (
        f"PASS walker.c: equal to the reference in every output bit of 125 steps on host-unrolled; 25 steps on {chips};"
        f" so is its table style on host-table, {chips}"
    )
    assert "cycles of cortex-m0: WCET = BCET, by Arm" in out
    assert err.splitlines()[0].startswith("episode 1 of 5: seed 0, 25 steps, reward -")


def test_it_is_found_in_the_working_folder_too(run: Run, folder: Path) -> None:
    (folder / "runs").mkdir()
    (folder / "champion.pkl").rename(folder / "runs" / "champion.pkl")
    written(plain_champion(), folder, stem="walker")
    status, out, _ = run("runs/champion.pkl", "--episodes", "1", *HOST)
    assert status == 0
    assert "checking walker.c (style unrolled) against runs/champion.pkl" in out


def test_without_any_c_it_is_generated_and_said(run: Run, folder: Path) -> None:
    status, out, _ = run("--episodes", "1", *HOST, "--json", "v.json")
    assert status == 0
    assert "no generated C for this controller beside champion.pkl or here: generated it for this check alone" in out
    assert json.loads(Path("v.json").read_text())["c_file"] is None
    assert sorted(path.name for path in folder.iterdir()) == ["champion.pkl", "v.json"]


def test_the_json_is_the_report(run: Run, folder: Path) -> None:
    code = written(plain_champion(), folder, "table", stem="walker")
    status, _, _ = run("--episodes", "2", "--seed", "5", *HOST, "--json", "v.json")
    data = json.loads(Path("v.json").read_text())
    assert status == 0
    assert (data["verdict"], data["c_file"], data["c_sha256"]) == ("pass", "walker.c", code.content_sha256)
    assert (data["environment"], data["episodes"], data["steps"]) == ("Pendulum-v1", 2, 50)
    assert [target["style"] for target in data["targets"]] == ["unrolled", "table"]
    assert all(target["steps_compared"] == 2050 and target["mismatches"] == 0 for target in data["targets"])


def test_a_stale_file_is_status_1(run: Run, folder: Path) -> None:
    written(plain_champion(-1), folder, stem="walker")
    for arguments in ((), ("--c", "walker.c")):
        status, out, _ = run(*arguments, *HOST, "--json", "v.json")
        assert status == 1
        assert out.splitlines()[-1].startswith("FAIL walker.c: stale: generated for controller ")
        data = json.loads(Path("v.json").read_text())
        assert (data["verdict"], data["steps"], data["mismatch"]) == ("fail", 0, None)
        assert "stale" in data["failures"][0]


def test_an_edit_that_changes_what_it_does_is_status_1(run: Run, folder: Path) -> None:
    code = written(plain_champion(), folder, stem="walker")
    code.path.write_text(code.source.replace("256U)", "255U)"))
    status, out, _ = run("--episodes", "1", *HOST, "--json", "v.json")
    assert status == 1
    assert "failure: walker.c: edited: line " in out
    assert "FAIL host-unrolled (walker_step): " in out
    assert json.loads(Path("v.json").read_text())["mismatch"]["target"] == "host-unrolled (walker_step)"


def test_an_edit_that_changes_nothing_is_status_1(run: Run, folder: Path) -> None:
    code = written(plain_champion(), folder, stem="walker")
    code.path.write_text(code.source + "/* mine */\n")
    status, out, _ = run("--episodes", "1", *HOST)
    assert status == 1
    assert out.splitlines()[-1].startswith("FAIL walker.c: edited: line ")


def test_a_stale_file_of_the_champions_name_is_status_1_beside_a_matching_one(run: Run, folder: Path) -> None:
    written(plain_champion(), folder, stem="walker")
    written(plain_champion(-1), folder, stem="champion")
    status, out, _ = run(*HOST)
    assert status == 1
    assert out.splitlines()[-1].startswith("FAIL champion.c: stale: ")


def test_a_planted_fault_is_reported_and_is_status_1(run: Run, folder: Path) -> None:
    code = written(plain_champion(), folder, "table", stem="walker")
    status, out, _ = run("--episodes", "1", "--inject-fault", "0", "--json", "v.json")
    data = json.loads(Path("v.json").read_text())
    assert status == 1
    assert "planted fault 0 in a copy of walker.c (style table): line " in out
    assert "FAIL " in out
    assert (data["verdict"], data["fault"]["number"], data["c_file"]) == ("fail", 0, "walker.c")
    assert code.path.read_text() == code.source


def test_a_campaign_counts_what_is_caught_and_lists_each_fault(run: Run, folder: Path) -> None:
    written(plain_champion(), folder, "table", stem="walker")
    status, out, _ = run("--episodes", "1", *HOST, "--fault-campaign", "3", "--json", "v.json")
    faults = json.loads(Path("v.json").read_text())["faults"]
    assert (faults["count"], len(faults["results"])) == (3, 3)
    assert sum(faults["outcomes"].values()) == 3
    assert status == (1 if faults["outcomes"]["unreached"] else 0)
    assert f"{faults['caught']} of 3 planted faults make verify fail" in out


def test_a_module_is_imported_only_if_the_user_names_it(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "verify_stranger.py").write_text("open('imported', 'w').close()\n")
    monkeypatch.syspath_prepend(folder)
    whose = plain_champion()
    spec = EnvironmentSpec("Pendulum-v1", {}, ("verify_stranger",))
    save_pickle(replace(whose, environment=spec), folder / "champion.pkl")
    status, _, err = run("--episodes", "1", "--targets", "host-unrolled")
    assert status == 2
    assert "needs --import verify_stranger" in err
    assert not Path("imported").exists()
    status, _, _ = run("--episodes", "1", "--targets", "host-unrolled", "--import", "verify_stranger")
    assert status == 0
    assert Path("imported").exists()


def test_hardcore_runs_the_other_environment(run: Run, folder: Path) -> None:
    save_pickle(champion("BipedalWalker-v3", seed=1), folder / "champion.pkl")
    status, out, _ = run("--episodes", "1", "--hardcore", "--targets", "host-unrolled")
    assert status == 0
    assert "BipedalWalkerHardcore-v3: 1 episode, 25 steps" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing.pkl"], "nothing.pkl: cannot read: No such file or directory"),
        (["--c", "nothing.c"], "nothing.c: cannot read: No such file or directory"),
        (["--c", "foreign.c"], "foreign.c: not a controller generated by bitneat"),
        (["--targets", "cortex-m99"], "--targets cortex-m99: no such target; the targets are host-unrolled"),
        (["--targets", ","], "--targets: names no target; the targets are host-unrolled"),
        (
            ["--c", "walker.c", "--targets", "host-table"],
            "--targets: no target of these runs walker.c (style unrolled); add host-unrolled",
        ),
        (["--c", "cart.c"], "cart.c: is of another controller ("),
        (["--c", "renamed.c"], "renamed.c: has no function renamed_step, although it says that it is renamed"),
        (["--vectors", "0"], "argument --vectors: '0' is not a whole number in 1..10000000"),
        (["--json", "no/v.json"], "no/v.json: cannot write: No such file or directory"),
        (["--episodes", "0"], "argument --episodes: '0' is not a whole number in 1..100000"),
        (["--inject-fault", "1", "--fault-campaign", "2"], "not allowed with argument"),
        (["--hardcore"], "environment BipedalWalkerHardcore-v3: has 24 observations, the controller 3"),
    ],
)
def test_bad_input_is_one_line_and_status_2(arguments: list[str], message: str, run: Run, folder: Path) -> None:
    (folder / "foreign.c").write_text("int x;\n")
    written(champion("CartPole-v1", seed=2), folder, stem="cart")
    renamed = written(plain_champion(), folder, stem="renamed")
    renamed.path.write_text(renamed.source.replace("renamed_step(", "other_step("))
    written(plain_champion(), folder, stem="walker")
    status, out, err = run(*arguments)
    assert status == 2
    assert "PASS" not in out
    assert err.startswith("bitneat: ")
    assert message in err
    assert err.count("\n") == 1


def test_a_compiler_that_does_not_work_is_one_line_and_status_2(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(plain_champion(), folder, stem="walker")
    monkeypatch.setenv("CC", "/nonexistent/cc")
    status, _, err = run()
    assert (status, err) == (
        2,
        "bitneat: CC=/nonexistent/cc: not a working C compiler; set CC to one, or unset it\n",
    )


def test_a_hostile_champion_runs_nothing(run: Run, folder: Path) -> None:
    (folder / "evil.pkl").write_bytes(b"cos\nsystem\n(S'touch owned'\ntR.")
    status, _, err = run("evil.pkl")
    assert status == 2
    assert "refused" in err
    assert not (folder / "owned").exists()


def test_a_champion_without_an_environment_is_bad_input(run: Run, folder: Path) -> None:
    save_pickle(replace(plain_champion(), environment=None), folder / "champion.pkl")
    status, _, err = run(*HOST)
    assert status == 2
    assert "champion.pkl: names no environment, so there is no loop to verify it in" in err


def test_neither_command_imports_neat(folder: Path) -> None:
    code = (
        "import sys\n"
        "from bitneat.cli import main\n"
        "status = main(['verify', '--episodes', '1', '--targets', 'host-unrolled']) + main(['size', '--targets', 'host-table'])\n"
        "print(status, sorted(name for name in sys.modules if name.split('.')[0] == 'neat'))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "0 []"


def test_interrupting_it_leaves_no_process(folder: Path, monkeypatch: pytest.MonkeyPatch, run: Run) -> None:
    from bitneat.verify import implementation

    started: list[Any] = []
    popen = implementation.subprocess.Popen

    def remembered(*args: Any, **options: Any) -> Any:
        started.append(popen(*args, **options))
        return started[-1]

    def interrupted(*args: Any, **options: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(implementation.subprocess, "Popen", remembered)
    monkeypatch.setattr(check, "closed_loop", interrupted)
    status, _, err = run(*HOST)
    assert (status, err) == (130, "bitneat: interrupted\n")
    assert started
    assert all(process.poll() is not None for process in started if "bitneat.verify.child" in process.args)
