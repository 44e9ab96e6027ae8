# SPDX-License-Identifier: MIT
"""Evolution with the native walker: the same bytes as with Gymnasium, checked while it runs, and stopped at once."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import bitneat.sim.walker.original as original
import bitneat.sim.walker.trigonometry as trigonometry
from bitneat.champion import EnvironmentSpec
from bitneat.cli.main import main
from bitneat.controller import Controller
from bitneat.errors import BitneatError
from bitneat.evolve.config import parse
from bitneat.evolve.evaluation import GymnasiumEvaluator, NativeWalkerEvaluator
from bitneat.evolve.genome import BitGenome
from bitneat.evolve.search import Search
from bitneat.native.compiler import CompilerError
from bitneat.sim import bipedal
from bitneat.sim.environment import EpisodeResult, Shaping, inspect
from tests.evolve.test_run import assert_all_gone, start, wait_for
from tests.sealed import sealed

WALKER = EnvironmentSpec("BipedalWalker-v3")
HARDCORE = EnvironmentSpec("BipedalWalkerHardcore-v3")
SMALL = """
[evolve]
generations = 3
race_episodes = 1 3
race_fractions = 1 0.3
selection_episodes = 2
final_episodes = 3
report_episodes = 3
finalists = 2
search_steps = 90
max_steps = 150
fall_reward = -100
fall_value_start = 0
fall_value_end = -50
fall_ramp_end = 2
stall_steps = 40
stall_gain = 1
[NEAT]
pop_size = 20
[BitGenome]
initial_links = 3
mutate_bias = 1
mutate_delay = 1
"""
FILES = ("champion.pkl", "champion.json", "history.csv", "report.json", "checkpoints/generation-000003.json")


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("small.ini").write_text(SMALL)
    return "small.ini"


def evolved(small: str, run: str, *options: str, environment: str = WALKER.id) -> dict[str, bytes]:
    assert main(["evolve", "--env", environment, "--config", small, "--seed", "4", "-o", run, *options]) == 0
    return {name: (Path(run) / name).read_bytes() for name in FILES}


def some_controllers(spec: EnvironmentSpec, count: int) -> list[Controller]:
    search = Search(parse(SMALL.replace("20", str(count)), "test"), spec, inspect(spec), seed=2)
    return [controller_of(search, genome) for genome in search.population.population.values()]


def controller_of(search: Search, genome: BitGenome) -> Controller:
    (controller,) = search.kind.lower(genome)
    assert isinstance(controller, Controller)
    return controller


@pytest.mark.parametrize("spec", [WALKER, HARDCORE])
def test_a_run_leaves_the_same_bytes_with_any_simulator_and_any_workers(small: str, spec: EnvironmentSpec) -> None:
    truth = evolved(small, "gymnasium", "--simulator", "gymnasium", "--workers", "1", environment=spec.id)
    for options in (("native", "1"), ("native", "3"), ("native", "256"), ("auto", "2")):
        run = "-".join(options)
        simulator, workers = options
        assert evolved(small, run, "--simulator", simulator, "--workers", workers, environment=spec.id) == truth, run


@pytest.mark.parametrize(
    "spec",
    [
        WALKER,
        HARDCORE,
        EnvironmentSpec(WALKER.id, {"hardcore": True}),
        EnvironmentSpec(HARDCORE.id, {"hardcore": False}),
    ],
)
@pytest.mark.parametrize("simulator", ["auto", "gymnasium"])
def test_the_native_evaluator_gives_gymnasiums_episodes(spec: EnvironmentSpec, simulator: str) -> None:
    controllers = some_controllers(spec, 6)
    seeds = [0, 7, 2**30]
    gymnasium = GymnasiumEvaluator(spec, inspect(spec).action, 130, 1, simulator)
    native = NativeWalkerEvaluator(spec, 130, 2)
    for shaping in (None, Shaping(-100.0, -7.0, 3.0, 90, 30, 0.5)):
        assert native.evaluate(controllers, seeds, shaping) == gymnasium.evaluate(controllers, seeds, shaping)


def test_the_time_limit_is_the_environments_own() -> None:
    # A controller without links does nothing, and the walker stands or falls as Gymnasium's does.
    search = Search(parse("[BitGenome]\ninitial_links = 0\nnum_hidden = 0", "test"), HARDCORE, inspect(HARDCORE), 1)
    idle = controller_of(search, next(iter(search.population.population.values())))
    assert search.max_steps == 2000
    result = NativeWalkerEvaluator(HARDCORE, search.max_steps, 1).evaluate([idle], [1])[0][0]
    assert result == GymnasiumEvaluator(HARDCORE, search.info.action, 2000, 1).evaluate([idle], [1])[0][0]


# --- which simulator runs ---


def without_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> Any:
        raise CompilerError("no C compiler found; install one")

    monkeypatch.setattr(original, "library", fail)
    monkeypatch.setattr(trigonometry, "library", fail)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--env", "CartPole-v1"], "with no argument but hardcore=True or False, not CartPole-v1"),
        (["--env-arg", "render_mode='rgb_array'"], "not BipedalWalker-v3 with render_mode='rgb_array'"),
        (["--env-arg", "hardcore=1"], "not BipedalWalker-v3 with hardcore=1"),
    ],
)
def test_the_native_simulator_is_refused_in_one_line_where_it_does_not_serve(
    small: str, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evolve", *arguments, "--config", small, "--simulator", "native", "-o", "run"]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1
    assert "--simulator native: serves BipedalWalker-v3 and BipedalWalkerHardcore-v3" in errors[0]
    assert message in errors[0]
    assert not Path("run").exists()


def test_without_a_compiler_auto_falls_back_and_native_says_why(
    small: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = evolved(small, "native", "--simulator", "native")
    without_a_compiler(monkeypatch)
    capsys.readouterr()
    assert main(["evolve", "--config", small, "--simulator", "native", "-o", "refused"]) == 2
    assert "--simulator native: no C compiler found" in capsys.readouterr().err
    monkeypatch.setattr(NativeWalkerEvaluator, "evaluate", None)
    assert evolved(small, "auto", "--workers", "1") == truth
    assert "cannot be used: no C compiler found" in capsys.readouterr().err
    assert json.loads(Path("auto/run.json").read_text())["trigonometry"] is None


def test_another_gymnasium_is_not_served(monkeypatch: pytest.MonkeyPatch) -> None:
    assert original.obstacle(WALKER) is None, "another Gymnasium: check the native walker against it, add its digest"
    monkeypatch.setattr(original, "_digest", lambda: "another")
    assert "is not the one of Gymnasium 1.4" in str(original.obstacle(WALKER))


def test_another_environment_under_the_walkers_name_is_not_served(monkeypatch: pytest.MonkeyPatch) -> None:
    from gymnasium.envs.registration import registry

    other = dataclasses.replace(registry[WALKER.id], entry_point="elsewhere:BipedalWalker")
    monkeypatch.setitem(registry, WALKER.id, other)
    assert not bipedal.serves(WALKER)
    assert original.obstacle(WALKER) is not None


# --- the check on Gymnasium ---


def plant(monkeypatch: pytest.MonkeyPatch, generations: int) -> None:
    """From the given generation on the native walker's rewards are a little wrong."""
    truthful = NativeWalkerEvaluator.evaluate
    races = [0]

    def evaluate(
        self: NativeWalkerEvaluator,
        controllers: Sequence[Controller],
        seeds: Sequence[int],
        shaping: Shaping | None = None,
    ) -> list[list[EpisodeResult]]:
        results = truthful(self, controllers, seeds, shaping)
        races[0] += len(controllers) > 6  # the first stage of a race
        if races[0] <= generations or shaping is not None:
            return results
        return [[dataclasses.replace(e, reward=e.reward + 1000.0 + 2.0**-40) for e in episodes] for episodes in results]

    monkeypatch.setattr(NativeWalkerEvaluator, "evaluate", evaluate)


@pytest.mark.parametrize("generations", [0, 1, 2])
def test_a_difference_from_gymnasium_stops_the_run_which_resumes_with_gymnasium(
    small: str, generations: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = evolved(small, "whole", "--simulator", "gymnasium", "--workers", "1")
    arguments = ["evolve", "--config", small, "--seed", "4", "-o", "run"]
    with monkeypatch.context() as patch:
        plant(patch, generations)
        capsys.readouterr()
        assert main(arguments) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert f"seed {2**30}: the native simulator's reward " in error
    assert "is not Gymnasium's" in error
    assert "use --simulator gymnasium" in error
    assert len(list(Path("run/checkpoints").iterdir())) == generations
    assert main(["evolve", "--resume", "run", "--simulator", "gymnasium", "--workers", "1"]) == 0
    assert {name: (Path("run") / name).read_bytes() for name in FILES} == whole


def test_only_new_leaders_and_the_champion_are_compared(small: str, monkeypatch: pytest.MonkeyPatch) -> None:
    import bitneat.evolve.recheck as recheck

    truth = evolved(small, "compared")
    compared = []
    evaluate = GymnasiumEvaluator.evaluate

    def counted(self: GymnasiumEvaluator, controllers: Any, seeds: Any, shaping: Any = None) -> Any:
        compared.append((controllers[0].sha256, list(seeds), shaping))
        return evaluate(self, controllers, seeds, shaping)

    with monkeypatch.context() as patch:
        patch.setattr(GymnasiumEvaluator, "evaluate", counted)
        assert evolved(small, "counted") == truth
    assert 1 <= len(compared) <= 4
    assert all(seeds == [2**30] and shaping is None for _, seeds, shaping in compared)
    champion = json.loads(Path("counted/champion.json").read_text())
    assert compared[-1][0] == Controller.from_data(champion["controller"]).sha256
    monkeypatch.setattr(recheck.Recheck, "__call__", lambda self, candidate: None)
    assert evolved(small, "unchecked") == truth


# --- trigonometry ---


def test_a_walkers_run_records_the_trigonometry_with_any_simulator(small: str) -> None:
    expected = trigonometry.probe()
    assert expected is not None
    assert len(expected) == 16
    for simulator in ("native", "gymnasium"):
        evolved(small, simulator, "--simulator", simulator, "--workers", "1")
        assert json.loads((Path(simulator) / "run.json").read_text())["trigonometry"] == expected
    evolved(small, "cartpole", "--workers", "1", environment="CartPole-v1")
    assert json.loads(Path("cartpole/run.json").read_text())["trigonometry"] is None


def test_a_resumed_run_keeps_to_its_trigonometry(small: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = evolved(small, "run")
    path = Path("run/run.json")
    data = json.loads(path.read_text())
    path.write_text(sealed({**data, "trigonometry": "0123456789abcdef"}))
    capsys.readouterr()
    for options in ((), ("--simulator", "gymnasium"), ("--generations", "9")):
        assert main(["evolve", "--resume", "run", *options]) == 2
        errors = capsys.readouterr().err.splitlines()
        assert len(errors) == 1
        assert "run/run.json: trigonometry: expected a C library whose sinf, cosf and atan2f hash to 0123" in errors[0]
        assert f"got {data['trigonometry']}" in errors[0]
    for known in ("null", None):  # unknown, and a run of before it was recorded
        path.write_text(
            sealed({k: v for k, v in data.items() if k != "trigonometry"} | ({"trigonometry": None} if known else {}))
        )
        assert main(["evolve", "--resume", "run"]) == 0
        assert Path("run/champion.pkl").read_bytes() == before["champion.pkl"]


def test_what_is_not_known_is_not_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    here = trigonometry.probe()
    assert here is not None
    trigonometry.refuse_other(None, "worker", "0" * 16)
    trigonometry.refuse_other(here, "worker", here)
    trigonometry.refuse_other(here, "worker")
    with pytest.raises(BitneatError, match=f"worker 7: trigonometry: expected .* {here}, .* got 0{{16}};"):
        trigonometry.refuse_other(here, "worker 7", "0" * 16)
    without_a_compiler(monkeypatch)
    trigonometry.refuse_other("0" * 16, "worker")


# --- Ctrl-C ---


def test_an_interrupt_ends_an_evaluation_within_a_second() -> None:
    controllers = some_controllers(WALKER, 50)
    evaluator = NativeWalkerEvaluator(WALKER, 1600, 2)
    evaluator.evaluate(controllers[:2], [1])  # compiles
    sent = [0.0]

    def interrupt() -> None:
        sent[0] = time.monotonic()
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Timer(0.5, interrupt).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            evaluator.evaluate(controllers, range(20_000))
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - sent[0] < 1


def test_an_interrupted_native_run_says_how_to_continue(small: str) -> None:
    # A generation takes minutes, so that the signal comes while C runs.
    text = SMALL.replace("race_episodes = 1 3", "race_episodes = 900 901").replace("pop_size = 20", "pop_size = 400")
    Path(small).write_text(text.replace("stall_steps = 40", "stall_steps = 0"))
    process = start("--config", small, "--simulator", "native", "--workers", "2", "-o", "run")
    wait_for(Path("run/run.json").exists, process)
    time.sleep(1.5)
    sent = time.monotonic()
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert time.monotonic() - sent < 1.5  # the interpreter's own end included
    assert process.returncode == 130
    assert b"Traceback" not in errors
    assert b"bitneat: stopped; continue with: bitneat evolve --resume run" in errors
    assert_all_gone(process.pid)
