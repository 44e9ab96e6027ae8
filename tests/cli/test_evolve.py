# SPDX-License-Identifier: MIT
"""``bitneat evolve`` as a user meets it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

import tests.sim.strange  # noqa: F401 - registers environments
from bitneat import champion as champions
from bitneat.cli.main import main
from bitneat.evolve.run import Outcome
from bitneat.files import sole_user
from tests.sealed import resealed, sealed

TINY = """
[evolve]
race_episodes = 1 2
race_fractions = 1 0.3
selection_episodes = 1
final_episodes = 2
report_episodes = 2
finalists = 2
max_steps = 50
[NEAT]
pop_size = 8
"""
ENVIRONMENTS = (
    "BipedalWalker-v3",
    "BipedalWalkerHardcore-v3",
    "LunarLander-v3",
    "CartPole-v1",
    "Acrobot-v1",
    "Pendulum-v1",
    "MountainCarContinuous-v0",
)


@pytest.fixture
def tiny(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("tiny.ini").write_text(TINY)
    return "tiny.ini"


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_every_supported_environment_evolves(tiny: str, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "--env",
        name,
        "--config",
        tiny,
        "--generations",
        "2",
        "--workers",
        "1",
        "-o",
        "run",
        "--json",
        "out.json",
    ]
    assert main(["evolve", *arguments]) == 0
    champion = champions.load("run/champion.pkl")
    assert champion.environment is not None
    assert champion.environment.id == name
    assert champion.controller.is_ternary
    result = json.loads(Path("out.json").read_text())
    assert result["controller"]["sha256"] == champion.controller.sha256
    assert result["held_out"]["mean"] == champion.provenance["held_out"]["mean"]
    captured = capsys.readouterr()
    assert captured.err.count("\ngeneration ") == 2
    assert "2 held-out episodes" in captured.out
    assert not Path("champion.pkl").exists()


def test_without_a_folder_the_champion_is_copied_to_the_current_one(tiny: str) -> None:
    assert (
        main(
            ["evolve", "--env", "CartPole-v1", "--config", tiny, "--generations", "1", "--seed", "3", "--workers", "1"]
        )
        == 0
    )
    assert Path("champion.pkl").read_bytes() == Path("runs/CartPole-v1-3/champion.pkl").read_bytes()


def test_a_champion_in_the_current_folder_that_no_run_has_is_not_overwritten(
    tiny: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["evolve", "--env", "CartPole-v1", "--config", tiny, "--generations", "1", "--workers", "1"]
    copy = Path("champion.pkl")
    copy.write_bytes(b"of another environment")
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("bitneat: champion.pkl: exists and would be overwritten")
    assert error.count("\n") == 1
    assert (copy.read_bytes(), Path("runs").exists()) == (b"of another environment", False)
    assert main([*arguments, "-o", "elsewhere"]) == 0  # which copies nothing here
    assert copy.read_bytes() == b"of another environment"
    copy.unlink()
    for seed in ("1", "2"):  # the first one's is a copy
        assert main([*arguments, "--seed", seed]) == 0
        assert copy.read_bytes() == Path(f"runs/CartPole-v1-{seed}/champion.pkl").read_bytes()

    from bitneat.cli import evolve

    def meanwhile(*args: object, real: Callable[..., Outcome] = evolve._evolve) -> Outcome:
        outcome = real(*args)
        copy.write_bytes(b"put here meanwhile")
        return outcome

    monkeypatch.setattr(evolve, "_evolve", meanwhile)
    assert main([*arguments, "--seed", "3"]) == 0
    assert copy.read_bytes() == b"put here meanwhile"
    assert "the champion is runs/CartPole-v1-3/champion.pkl" in capsys.readouterr().err


def test_environment_arguments_reach_the_environment_and_the_champion(tiny: str) -> None:
    arguments = ["--env", "BipedalWalker-v3", "--env-arg", "hardcore=true", "--config", tiny, "--generations", "1"]
    assert main(["evolve", *arguments, "--workers", "1", "-o", "run"]) == 0
    environment = champions.load("run/champion.pkl").environment
    assert environment is not None
    assert environment.kwargs == {"hardcore": True}


def test_a_module_that_registers_an_environment_is_imported_by_workers_too(tiny: str) -> None:
    arguments = ["--env", "bitneat/Matrix-v0", "--import", "tests.sim.strange", "--config", tiny, "--generations", "1"]
    assert main(["evolve", *arguments, "--workers", "2", "-o", "run"]) == 0


def test_a_resumed_run_imports_what_the_user_names_again(
    tiny: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--env", "bitneat/Matrix-v0", "--import", "tests.sim.strange", "--config", tiny, "--generations", "1"]
    assert main(["evolve", *arguments, "--workers", "1", "-o", "run"]) == 0
    monkeypatch.setattr("bitneat.sim.environment._allowed_imports", set())
    assert main(["evolve", "--resume", "run", "--workers", "1"]) == 2
    assert "needs --import tests.sim.strange" in capsys.readouterr().err
    assert main(["evolve", "--resume", "run", "--import", "tests.sim.strange", "--workers", "1"]) == 0


def test_a_run_can_be_made_longer(tiny: str) -> None:
    common = ["--env", "CartPole-v1", "--config", tiny, "--workers", "1"]
    assert main(["evolve", *common, "--generations", "2", "-o", "short"]) == 0
    assert main(["evolve", "--resume", "short", "--generations", "3", "--workers", "1"]) == 0
    assert main(["evolve", *common, "--generations", "3", "-o", "long"]) == 0
    assert Path("short/champion.pkl").read_bytes() == Path("long/champion.pkl").read_bytes()


@pytest.mark.parametrize("command", ["evolve", "linear"])
def test_a_run_that_another_process_continues_is_left_alone(
    tiny: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    more = ["--config", tiny] if command == "evolve" else ["--pop", "12"]
    assert main([command, "--env", "CartPole-v1", *more, "--generations", "2", "--workers", "1", "-o", "run"]) == 0
    before = {path: path.read_bytes() for path in Path("run").rglob("*") if path.is_file()}
    capsys.readouterr()
    resume = [command, "--resume", "run", "--generations", "3", "--workers", "1"]
    with sole_user(Path("run")):
        assert main(resume) == 2
    error = capsys.readouterr().err
    assert error == "bitneat: run: another process is at work there; expected a run that none continues\n"
    assert before == {path: path.read_bytes() for path in Path("run").rglob("*") if path.is_file()}
    assert main(resume) == 0


def test_a_run_can_go_on_under_another_configuration_and_records_both(tiny: str) -> None:
    Path("next.ini").write_text(TINY + "[BitReproduction]\ncrossover = 0.5\n")
    assert (
        main(["evolve", "--env", "CartPole-v1", "--config", tiny, "--generations", "2", "--workers", "1", "-o", "run"])
        == 0
    )
    first = Path("run/config.ini").read_text()
    arguments = ["--resume", "run", "--config", "next.ini", "--generations", "3", "--workers", "1"]
    assert main(["evolve", *arguments]) == 0
    provenance = champions.load("run/champion.pkl").provenance
    assert provenance["earlier"] == [{"generations": 2, "config": first}]
    assert "crossover = 0.5" in provenance["config"]
    content = Path("run/champion.pkl").read_bytes()
    assert main(["evolve", "--resume", "run", "--workers", "1"]) == 0
    assert Path("run/champion.pkl").read_bytes() == content


@pytest.mark.parametrize(("key", "value"), [("max_steps", 60), ("selection_episodes", 2)])
def test_a_run_goes_on_only_with_the_episodes_that_its_candidates_were_scored_on(
    tiny: str, key: str, value: int, capsys: pytest.CaptureFixture[str]
) -> None:
    common = ["--env", "CartPole-v1", "--config", tiny, "--workers", "1"]
    assert main(["evolve", *common, "--generations", "2", "-o", "run"]) == 0
    Path("next.ini").write_text(re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", TINY))
    before = Path("run/run.json").read_bytes()
    capsys.readouterr()
    assert main(["evolve", "--resume", "run", "--config", "next.ini", "--generations", "3"]) == 2
    error = capsys.readouterr().err
    assert f"--config next.ini: [evolve] {key}: a run that has begun keeps its " in error
    assert error.count("\n") == 1
    assert Path("run/run.json").read_bytes() == before


@pytest.mark.parametrize("preset", ["paper-int", "paper-wann", "paper-softmax"])
def test_a_configuration_that_a_run_cannot_go_on_under_changes_nothing(
    tiny: str, preset: str, capsys: pytest.CaptureFixture[str]
) -> None:
    common = ["--env", "CartPole-v1", "--config", tiny, "--workers", "1"]
    assert main(["evolve", *common, "--generations", "2", "-o", "run"]) == 0
    before = {path: path.read_bytes() for path in Path("run").rglob("*") if path.is_file()}
    capsys.readouterr()
    assert main(["evolve", "--resume", "run", "--config", preset]) == 2
    error = capsys.readouterr().err
    assert f"--config {preset}: [NEAT]" in error
    assert error.count("\n") == 1
    assert {path: path.read_bytes() for path in Path("run").rglob("*") if path.is_file()} == before
    assert main(["evolve", "--resume", "run", "--generations", "3", "--workers", "1"]) == 0


PLAIN = TINY.replace("[NEAT]", "[NEAT]\ngenome = PlainGenome\nreproduction = PlainReproduction")
PLAIN += "[PlainGenome]\nweights = {}\nactivations = {}\n"


def activations_of(checkpoint: Path) -> list[str]:
    population = json.loads(checkpoint.read_text())["search"]["population"]
    return [node[2] for _, _, nodes, _ in population for node in nodes]


@pytest.mark.parametrize("old", [False, True])
def test_genomes_keep_their_activations_under_another_configuration(tiny: str, old: bool) -> None:
    del tiny
    listed = "clamped relu sin"
    Path("plain.ini").write_text(PLAIN.format("ternary", listed))
    Path("next.ini").write_text(PLAIN.format("ternary", "sin clamped"))
    common = ["--config", "plain.ini", "--generations", "2", "--workers", "1"]
    assert main(["evolve", "--env", "CartPole-v1", *common, "-o", "run"]) == 0
    checkpoint = Path("run/checkpoints/generation-000002.json")
    before = activations_of(checkpoint)
    assert {"clamped", "relu"} <= set(before)
    if old:  # numbers, which the configuration's list explains
        data = json.loads(checkpoint.read_text())
        for _, _, nodes, _ in data["search"]["population"]:
            for node in nodes:
                node[2] = listed.split().index(node[2])
        checkpoint.write_text(sealed(data))
    assert main(["evolve", "--resume", "run", "--config", "next.ini", "--generations", "2", "--workers", "1"]) == 0
    assert activations_of(checkpoint) == before
    assert main(["evolve", "--resume", "run", "--generations", "3", "--workers", "1"]) == 0


def test_a_run_keeps_its_kind_of_weights(tiny: str, capsys: pytest.CaptureFixture[str]) -> None:
    del tiny
    Path("plain.ini").write_text(PLAIN.format("float", "clamped sin"))
    Path("next.ini").write_text(PLAIN.format("integer", "clamped sin"))
    common = ["--config", "plain.ini", "--generations", "1", "--workers", "1"]
    assert main(["evolve", "--env", "CartPole-v1", *common, "-o", "run"]) == 0
    capsys.readouterr()
    assert main(["evolve", "--resume", "run", "--config", "next.ini", "--generations", "2"]) == 2
    expected = "bitneat: --config next.ini: [PlainGenome] weights: a run that has begun keeps its float weights\n"
    assert capsys.readouterr().err == expected


def test_a_linear_population_is_free_where_there_is_no_linear_start(tiny: str) -> None:
    Path("next.ini").write_text(TINY.replace("[evolve]", "[evolve]\nlinear_population = 7"))
    assert main(["evolve", "--env", "CartPole-v1", "--config", tiny, "--generations", "1", "-o", "run"]) == 0
    assert main(["evolve", "--resume", "run", "--config", "next.ini", "--generations", "2"]) == 0


def test_a_run_whose_checkpoint_is_damaged_keeps_its_configuration(
    tiny: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evolve", "--env", "CartPole-v1", "--config", tiny, "--generations", "2", "-o", "run"]) == 0
    (checkpoint,) = Path("run/checkpoints").glob("generation-000002.json")
    resealed(checkpoint, '"next_species":', '"nothing":')
    before = {name: Path("run", name).read_bytes() for name in ("config.ini", "run.json")}
    assert main(["evolve", "--resume", "run", "--generations", "9"]) == 2
    assert f"{checkpoint}: damaged" in capsys.readouterr().err
    assert {name: Path("run", name).read_bytes() for name in before} == before


def test_a_time_limit_ends_a_run_and_says_that_it_is_not_reproducible(
    tiny: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--env", "CartPole-v1", "--config", tiny, "--generations", "100000", "--time", "0.5", "--workers", "1"]
    assert main(["evolve", *arguments, "-o", "run"]) == 0
    captured = capsys.readouterr()
    assert "cannot be reproduced" in captured.err
    assert "stopped by --time" in captured.out
    assert champions.load("run/champion.pkl").provenance["reproducible"] is False


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--env", "NoSuch-v0"], "environment NoSuch-v0"),
        (["--env", "bitneat/Dict-v0"], "Dict space, expected a Box"),
        (["--env", "bitneat/Image-v0"], "an image of shape"),
        (["--env", "bitneat/Endless-v0", "--config", "default"], "has no time limit; set [evolve] max_steps"),
        (["--env", "bitneat/Failing-v0"], "an episode failed: RuntimeError: the wheels came off"),
        (["--env", "bitneat/NaN-v0"], "holds a NaN"),
        (["--env", "CartPole-v1", "--env-arg", "wings=2"], "environment CartPole-v1: "),
        (["--env-arg", "hardcore"], "--env-arg hardcore: expected NAME=VALUE"),
        (["--env-arg", "a=b'x'"], "--env-arg a: a bytes is not plain data"),
        (["--env-arg", "a=1e999"], "--env-arg a: a number is not finite"),
        (["--env-arg", "a=[1, {2: 3}]"], "--env-arg a: a key is not a string"),
        (["--env-arg", "a='\\ud800'"], "--env-arg a: a text is not Unicode"),
        (["--env-arg", "a=\udcff"], "--env-arg a: a text is not Unicode"),
        (["--env-arg", "a=" + "9" * 1000], "--env-arg a: an integer has more than 1024 bits"),
        (["--import", "no_such_module"], "--import no_such_module"),
        (["--import", ""], "argument --import: expected a value, got an empty one"),
        (["--import", ".x"], "--import '.x': expected the name of a module"),
        (["--env", "no_such_module:Some-v0"], "an id with ':' imports a module"),
        (["--env", "bitneat/Broken-v0"], "cannot be made: KeyError"),
        (["--env", "bitneat/NaNReward-v0"], "a reward of seed"),
        (["--env", "bitneat/Huge-v0"], "environment bitneat/Huge-v0: its observation has 16900 components"),
        (["--config", "none.ini"], "none.ini: neither a file nor a preset"),
        (["--pop", "1"], "--pop"),
        (["--generations", "0"], "--generations"),
        (["--time", "-1"], "--time -1.0: expected"),
        (["--time", "nan"], "--time nan: expected a number of seconds above 0, or none"),
        (["--workers", "0"], "--workers"),
        (["--seed", "-1"], "--seed"),
        (["--resume", "nowhere"], "--resume nowhere: holds no run"),
        (["--resume", "nowhere", "--seed", "3"], "--seed: not with --resume"),
        (["-o", "tiny.ini"], "tiny.ini"),
        (["-o", "/proc/run"], "/proc/run: cannot be made"),
    ],
)
def test_bad_input_is_one_line_and_exit_status_2(
    tiny: str, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    defaults = [] if "--config" in arguments or "--resume" in arguments else ["--config", tiny]
    limit = [] if "--resume" in arguments or "--generations" in arguments else ["--generations", "1"]
    workers = [] if "--workers" in arguments else ["--workers", "1"]
    assert main(["evolve", *arguments, *defaults, *limit, *workers]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert message in errors[-1]
    assert not [line for line in errors if "Traceback" in line]


def test_a_configuration_that_does_not_fit_the_environment_is_named(
    tiny: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("scaled.ini").write_text(TINY.replace("[NEAT]", "input_scales = 1 2 3\n[NEAT]"))
    arguments = ["--env", "CartPole-v1", "--config", "scaled.ini", "--generations", "1", "--workers", "1", "-o", "run"]
    assert main(["evolve", *arguments]) == 2
    expected = "bitneat: scaled.ini: [evolve] input_scales: expected 1 or 4 integers, got 3\n"
    assert capsys.readouterr().err.endswith(expected)


def test_an_existing_run_is_not_overwritten(tiny: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "evolve",
        "--env",
        "CartPole-v1",
        "--config",
        tiny,
        "--generations",
        "1",
        "--workers",
        "1",
        "-o",
        "run",
    ]
    assert main(arguments) == 0
    before = Path("run/champion.pkl").read_bytes()
    assert main(arguments) == 2
    assert "continue it with --resume run" in capsys.readouterr().err
    assert Path("run/champion.pkl").read_bytes() == before


def test_a_run_that_failed_before_its_first_generation_is_not_in_the_way(
    tiny: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--config", tiny, "--generations", "1", "--workers", "1", "-o", "run"]
    assert main(["evolve", "--env", "bitneat/NaN-v0", *arguments]) == 2
    assert "holds a NaN" in capsys.readouterr().err
    assert not Path("run").exists()
    assert main(["evolve", "--env", "CartPole-v1", *arguments]) == 0


def test_a_run_cannot_be_made_shorter(tiny: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--env", "CartPole-v1", "--config", tiny, "--generations", "2", "--workers", "1", "-o", "run"]
    assert main(["evolve", *arguments]) == 0
    settings = Path("run/config.ini").read_text()
    assert main(["evolve", "--resume", "run", "--generations", "1", "--workers", "1"]) == 2
    assert "has completed 2 generations, more than the 1 asked for" in capsys.readouterr().err
    assert Path("run/config.ini").read_text() == settings


def test_a_second_interrupt_while_it_closes_leaves_the_terminal_as_it_was_and_says_how_to_go_on(
    tiny: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from bitneat.evolve.evaluation import GymnasiumEvaluator
    from bitneat.evolve.progress import PlainProgress

    closed: list[str] = []

    def interrupt(self: object, *arguments: object) -> None:
        raise KeyboardInterrupt

    def close(self: object) -> None:
        closed.append("the view")

    monkeypatch.setattr(GymnasiumEvaluator, "evaluate", interrupt)
    monkeypatch.setattr(GymnasiumEvaluator, "close", interrupt)
    monkeypatch.setattr(PlainProgress, "close", close)
    assert main(["evolve", "--env", "CartPole-v1", "--config", tiny, "--workers", "1", "-o", "run"]) == 130
    assert closed == ["the view"]
    assert capsys.readouterr().err.splitlines()[-1] == "bitneat: stopped; continue with: bitneat evolve --resume run"


def test_a_time_limit_can_be_lifted_and_the_run_is_then_as_if_it_had_had_none(tiny: str) -> None:
    arguments = ["evolve", "--env", "CartPole-v1", "--config", tiny, "--generations", "3", "--workers", "1"]
    assert main([*arguments, "-o", "whole"]) == 0
    assert main([*arguments, "-o", "cut", "--time", "1e-9"]) == 0
    assert json.loads(Path("cut/run.json").read_text())["seconds"] == 1e-9
    assert main(["evolve", "--resume", "cut", "--time", "none", "--workers", "1"]) == 0
    for path in (path for path in Path("whole").rglob("*") if path.is_file()):
        assert (Path("cut") / path.relative_to("whole")).read_bytes() == path.read_bytes(), path


def test_a_time_limit_that_cuts_nothing_off_changes_nothing(tiny: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["evolve", "--env", "CartPole-v1", "--config", tiny, "--generations", "2", "--workers", "1"]
    assert main([*arguments, "-o", "run"]) == 0
    before = {path: path.read_bytes() for path in Path("run").rglob("*") if path.is_file()}
    for limit in ("1e-9", "1000"):
        assert main(["evolve", "--resume", "run", "--workers", "1", "--time", limit]) == 0
    assert main(["evolve", "--resume", "run", "--workers", "1"]) == 0
    assert {path: path.read_bytes() for path in Path("run").rglob("*") if path.is_file()} == before
    assert main([*arguments, "-o", "limited", "--time", "1000"]) == 0
    assert Path("limited/champion.pkl").read_bytes() == Path("run/champion.pkl").read_bytes()
    assert "cannot be reproduced" not in capsys.readouterr().err


def test_the_same_change_of_configuration_given_again_is_no_other_change(tiny: str) -> None:
    Path("next.ini").write_text(TINY + "[BitReproduction]\ncrossover = 0.5\n")
    common = ["--env", "CartPole-v1", "--config", tiny, "--workers", "1"]
    for run in ("once", "twice"):
        assert main(["evolve", *common, "--generations", "2", "-o", run]) == 0
    change = ["--config", "next.ini", "--generations", "4", "--workers", "1"]
    assert main(["evolve", "--resume", "once", *change]) == 0
    assert main(["evolve", "--resume", "twice", *change, "--time", "0.000001"]) == 0  # stopped after a generation
    settings = json.loads(Path("twice/run.json").read_text())
    assert main(["evolve", "--resume", "twice", *change, "--time", "1000"]) == 0
    assert json.loads(Path("twice/run.json").read_text())["earlier"] == settings["earlier"]
    assert len(settings["earlier"]) == 1
    once, twice = (champions.load(f"{run}/champion.pkl") for run in ("once", "twice"))
    assert twice.controller == once.controller
    assert twice.provenance["earlier"] == once.provenance["earlier"]


def test_a_new_run_does_not_go_on_from_what_another_left(tiny: str, capsys: pytest.CaptureFixture[str]) -> None:
    common = ["evolve", "--env", "CartPole-v1", "--config", tiny, "--generations", "2", "--workers", "1", "-o", "run"]
    assert main(common) == 0
    for path in Path("run").iterdir():
        if path.is_file():
            path.unlink()
    capsys.readouterr()
    assert main([*common, "--seed", "5"]) == 2
    error = capsys.readouterr().err
    assert "run/checkpoints/generation-000001.json: exists" in error
    assert error.count("\n") == 1
    assert not Path("run/champion.pkl").exists()


@pytest.mark.parametrize("command", ["evolve", "polish", "linear"])
@pytest.mark.parametrize("seed", [str(1 << 1024), "9" * 5000, "-1", "one"])
def test_a_seed_that_could_not_be_read_again_is_refused_at_the_start(
    tiny: str, capsys: pytest.CaptureFixture[str], command: str, seed: str
) -> None:
    assert main([command, "--seed", seed, "-o", "run"]) == 2
    error = capsys.readouterr().err
    assert "argument --seed: " in error
    assert f"is not a whole number of 0 or more, of at most 1024 bits (see bitneat {command} --help)\n" in error
    assert error.count("\n") == 1
    assert not Path("run").exists()


def test_the_largest_seed_is_read_again(tiny: str) -> None:
    common = ["--env", "CartPole-v1", "--config", tiny, "--generations", "1", "--workers", "1", "-o", "run"]
    assert main(["evolve", *common, "--seed", str((1 << 1024) - 1)]) == 0
    assert main(["evolve", "--resume", "run", "--workers", "1"]) == 0
