# SPDX-License-Identifier: MIT
"""The functions of ``import bitneat``: they do what the commands do, and Gymnasium is the judge."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings

import bitneat
from bitneat.cli.main import main
from bitneat.controller import Controller, Encoder, Input, Link, Node, Reference, Signal, State
from bitneat.sim.environment import EnvironmentSpec
from tests.strategies import controllers_with_inputs

ROOT = Path(__file__).resolve().parents[1]
TINY = ROOT / "examples" / "champions" / "tiny.pkl"


@pytest.fixture(scope="module")
def tiny() -> bitneat.Champion:
    return bitneat.load(TINY)


def reward_in_gymnasium(champion: bitneat.Champion, environment: str, seed: int) -> float:
    """By a loop that anybody would write."""
    env = gymnasium.make(environment)
    agent = bitneat.Agent(champion)
    observation, _ = env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, _ = env.step(agent.act(observation))
        total += float(reward)
        over = terminated or truncated
    env.close()
    return total


def test_every_name_is_there_and_typed_alike() -> None:
    stub = (ROOT / "bitneat" / "__init__.pyi").read_text()
    for name in bitneat.__all__:
        assert callable(getattr(bitneat, name)) or name in ("__version__", "Environment"), name
        assert f"import {name} as {name}" in stub, name
        assert name in dir(bitneat)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        bitneat.nothing  # noqa: B018


@pytest.mark.parametrize(
    "before", ["", "import bitneat.evolve.run, bitneat.verify.check", "from bitneat.api import verify"]
)
def test_evolve_and_verify_are_functions_whatever_was_imported_before(before: str) -> None:
    code = f"{before}\nimport bitneat, inspect\nprint(inspect.signature(bitneat.evolve), inspect.signature(bitneat.verify))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "generations" in done.stdout
    assert "targets" in done.stdout


def test_importing_bitneat_imports_no_more_than_its_version() -> None:
    code = "import bitneat, sys\nprint([m for m in sys.modules if m.startswith('bitneat.') or m in ('numpy', 'neat')])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['bitneat.version']"


def test_an_agent_earns_what_evaluate_says(tiny: bitneat.Champion) -> None:
    episodes = bitneat.evaluate(tiny, 2, seed=4)
    assert [episode.reward for episode in episodes] == [
        reward_in_gymnasium(tiny, "BipedalWalker-v3", seed) for seed in (4, 5)
    ]
    assert bitneat.evaluate(tiny, 2, seed=4, simulator="gymnasium", workers=1) == episodes
    (short,) = bitneat.evaluate(tiny, 1, max_steps=50)
    assert short.steps == 50


@settings(max_examples=50)
@given(controllers_with_inputs())
def test_a_step_is_the_references_and_a_state_is_the_callers(case: tuple[Controller, list[list[int]]]) -> None:
    controller, sequence = case
    state = controller.new_state()
    assert [controller.step(row, state) for row in sequence] == Reference(controller).run(sequence)
    if not controller.is_recurrent:
        assert controller.step(sequence[0]) == Reference(controller).step(sequence[0])


def test_a_controller_with_memory_asks_for_its_state() -> None:
    counter = Controller((Input(limit=1),), (Node((Link(0), Link(1, delay=1))),), (Signal(1),))
    with pytest.raises(bitneat.BitneatError, match=r"needs a state; make one with new_state"):
        counter.step([1])
    first, second = counter.new_state(), counter.new_state()
    assert [counter.step([1], first)[0] for _ in range(3)] == [1, 2, 3]
    assert counter.step([1], second) == [1]
    with pytest.raises(bitneat.BitneatError, match=r"inputs\[0\] is 2, outside its limit"):
        counter.step([2], first)
    for wrong in ([0.9], ["1"]):
        with pytest.raises(bitneat.BitneatError, match="step: expected integers"):
            counter.step(wrong, first)  # type: ignore[arg-type]
    with pytest.raises(bitneat.BitneatError, match="the state has 0 signals, the controller 2"):
        counter.step([1], State([]))


def test_an_agent_forgets_between_episodes() -> None:
    counter = Controller((Input(limit=256),), (Node((Link(0), Link(1, delay=1))),), (Signal(1),))
    space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    from bitneat.controller import BoxAction

    agent = bitneat.Agent(bitneat.Champion(counter, BoxAction((-1.0,), (1.0,), (1,), "float32")))
    assert agent.act([0.25]) in space
    assert agent.act([0.25]) == [0.5]
    agent.reset()
    assert agent.act([0.25]) == [0.25]
    with pytest.raises(bitneat.BitneatError, match="observation: expected an array of numbers"):
        agent.act(["x"])
    assert agent.state.signals == [64, 64]


def test_generated_c_is_that_of_the_command(tiny: bitneat.Champion, tmp_path: Path) -> None:
    code = bitneat.generate(tiny, "legs", "unrolled", guard=True)
    source, header = code.write(tmp_path)
    assert (source.name, header.name) == ("legs.c", "legs.h")
    other = tmp_path / "other"
    other.mkdir()
    assert main(["codegen", str(TINY), "-o", str(other / "legs.c"), "--style", "unrolled", "--guard"]) == 0
    assert source.read_bytes() == (other / "legs.c").read_bytes()
    assert header.read_bytes() == (other / "legs.h").read_bytes()
    bare = bitneat.generate(tiny.controller, style="unrolled")
    assert "BipedalWalker" not in bare.header


def test_verify_judges_text_files_and_its_own(tiny: bitneat.Champion, tmp_path: Path) -> None:
    few = {"episodes": 1, "targets": "host-unrolled", "vectors": 100}
    code = bitneat.generate(tiny, "legs", "unrolled")
    report = bitneat.verify(tiny, code, **few)
    assert report.passed
    assert report.loop is not None
    assert report.loop.episodes[0].reward == bitneat.evaluate(tiny, 1)[0].reward
    assert bitneat.verify(tiny, **few).passed
    source, _ = code.write(tmp_path)
    assert bitneat.verify(tiny, source, **few).passed
    text = source.read_text()
    at = text.index("0x", text.index("legs_weights["))
    source.write_text(text[: at + 3] + ("1" if text[at + 3] == "0" else "0") + text[at + 4 :])
    report = bitneat.verify(tiny, source, **few)
    assert not report.passed
    assert "its weight table is not the one that codegen writes" in " ".join(report.failures)
    assert {
        target.name for target in bitneat.verify(tiny, targets="host-table, host-unrolled", episodes=1).targets
    } == {
        "host-table",
        "host-unrolled",
    }
    with pytest.raises(bitneat.BitneatError, match="vectors: 0: expected a number from 1"):
        bitneat.verify(tiny, vectors=0)
    with pytest.raises(bitneat.BitneatError, match="--targets z80: no such target"):
        bitneat.verify(tiny, targets="z80")


def test_sizes_and_packed_bytes_are_those_of_the_champion(tiny: bitneat.Champion) -> None:
    blob = bitneat.pack(tiny.controller)
    assert bitneat.unpack(blob) == tiny.controller.canonical
    assert bitneat.size(tiny, "host-table").to_data()["controller"]["packed_bytes"] == len(blob)


def test_a_run_is_the_commands_and_goes_on_when_it_is_stopped(tmp_path: Path) -> None:
    few = {"population": 6, "generations": 3, "seed": 5, "workers": 1}
    evolved = bitneat.evolve("CartPole-v1", output=tmp_path / "api", **few)
    assert [row["generation"] for row in evolved.history()] == [0, 1, 2]
    arguments = ["--env", "CartPole-v1", "--pop", "6", "--generations", "3", "--seed", "5", "--workers", "1"]
    assert main(["evolve", *arguments, "-o", str(tmp_path / "cli")]) == 0
    assert (tmp_path / "api" / "champion.pkl").read_bytes() == (tmp_path / "cli" / "champion.pkl").read_bytes()
    assert evolved.champion == bitneat.load(tmp_path / "api" / "champion.pkl")
    mean = np.mean([reward_in_gymnasium(evolved.champion, "CartPole-v1", seed) for seed in range(3)])
    assert mean == np.mean([episode.reward for episode in bitneat.evaluate(evolved.champion, 3)])

    class Stop:
        def __getattr__(self, name: str) -> object:
            def tell(*arguments: object) -> None:
                if name == "generation":
                    raise KeyboardInterrupt

            return tell

    with pytest.raises(KeyboardInterrupt):
        bitneat.evolve("CartPole-v1", output=tmp_path / "stopped", progress=Stop(), **few)  # type: ignore[arg-type]
    assert bitneat.resume(tmp_path / "stopped", workers=1).score == evolved.score
    assert (tmp_path / "stopped" / "champion.pkl").read_bytes() == (tmp_path / "api" / "champion.pkl").read_bytes()
    with pytest.raises(bitneat.BitneatError, match="holds a run already"):
        bitneat.evolve("CartPole-v1", output=tmp_path / "api", **few)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"seconds": 0}, "seconds: 0: expected a number above 0"),
        ({"seconds": "5"}, "seconds: '5': expected a number above 0"),
        ({"seed": -1}, "seed: -1: expected an integer from 0"),
        ({"seed": True}, "seed: True: expected an integer from 0"),
        ({"seed": 1.5}, "seed: 1.5: expected an integer from 0"),
        ({"seed": 1 << 1024}, "seed: of 1025 bits: expected an integer from 0, of at most 1024 bits"),
        ({"seed": 1 << 20000}, "seed: of 20001 bits: expected an integer from 0, of at most 1024 bits"),
        ({"simulator": "fast"}, "simulator 'fast': expected one of auto, native, gymnasium"),
        ({"simulator": "native"}, "--simulator native"),
        ({"config": "nothing"}, "nothing"),
        ({"environment": "Nowhere-v0"}, "Nowhere-v0"),
    ],
)
def test_what_cannot_run_is_said_in_a_line_and_leaves_no_folder(
    wrong: dict[str, object], message: str, tmp_path: Path
) -> None:
    arguments = {"environment": "CartPole-v1", "output": tmp_path / "run", **wrong}
    with pytest.raises(bitneat.BitneatError, match=message) as caught:
        bitneat.evolve(**arguments)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_an_evaluator_that_stops_elsewhere_is_refused(tmp_path: Path) -> None:
    class Short:
        max_steps = 7

    with pytest.raises(bitneat.BitneatError, match="evaluator: stops episodes after 7 steps, this run does after 500"):
        bitneat.evolve("CartPole-v1", evaluator=Short(), output=tmp_path / "run")  # type: ignore[arg-type]
    assert not (tmp_path / "run").exists()


def test_an_evaluator_of_another_environment_is_refused(tmp_path: Path) -> None:
    from bitneat.controller import DiscreteAction
    from bitneat.evolve.evaluation import GymnasiumEvaluator

    def evolve(spec: bitneat.EnvironmentSpec, action: DiscreteAction, max_steps: int, **few: int) -> bitneat.Evolved:
        evaluator = GymnasiumEvaluator(spec, action, max_steps, 1)
        return bitneat.evolve("CartPole-v1", evaluator=evaluator, output=tmp_path / "run", **few)  # type: ignore[arg-type]

    cart = bitneat.EnvironmentSpec("CartPole-v1")
    other = bitneat.EnvironmentSpec("CartPole-v1", {"sutton_barto_reward": True})
    message = "evaluator: is for CartPole-v1 with {'sutton_barto_reward': True}, this run is for CartPole-v1 with {}"
    with pytest.raises(bitneat.BitneatError, match=message):
        evolve(other, DiscreteAction(2), 500)
    with pytest.raises(bitneat.BitneatError, match=r"is for Acrobot-v1 with \{\}, this run is for CartPole-v1"):
        evolve(bitneat.EnvironmentSpec("Acrobot-v1"), DiscreteAction(2), 500)
    with pytest.raises(bitneat.BitneatError, match="evaluator: is for another action space than that of CartPole-v1"):
        evolve(cart, DiscreteAction(2, start=1), 500)
    with pytest.raises(bitneat.BitneatError, match="stops episodes after 60 steps, this run does after 500"):
        evolve(cart, DiscreteAction(2), 60)
    assert not (tmp_path / "run").exists()
    assert evolve(cart, DiscreteAction(2), 500, population=4, generations=1).finished


def test_a_script_without_a_guard_gets_a_line_that_says_so(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    call = "bitneat.evolve('CartPole-v1', population=4, generations=1, workers=2, output='run')"
    script.write_text(f"import bitneat\n{call}\n")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, script],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode != 0
    assert "put the call under: if __name__ == '__main__':" in done.stderr
    script.write_text(f"import bitneat\nif __name__ == '__main__':\n    {call}\n")
    subprocess.run([sys.executable, script], cwd=tmp_path, env=environment, check=True, timeout=120)


def test_a_run_that_fails_at_once_leaves_no_folder_in_the_way(tmp_path: Path) -> None:
    class Broken:
        def evaluate(self, *arguments: object) -> list[object]:
            raise bitneat.BitneatError("the cluster was lost")

        def close(self) -> None:
            raise AssertionError("it is the caller's")

    few = {"population": 4, "generations": 1, "output": tmp_path / "run"}
    with pytest.raises(bitneat.BitneatError, match="the cluster was lost"):
        bitneat.evolve("CartPole-v1", evaluator=Broken(), **few)  # type: ignore[arg-type]
    assert not (tmp_path / "run").exists()
    assert bitneat.evolve("CartPole-v1", workers=1, **few).finished  # type: ignore[arg-type]


def test_a_champion_without_a_time_limit_or_environment_is_refused_by_evaluate(tiny: bitneat.Champion) -> None:
    homeless = bitneat.Champion(tiny.controller, tiny.action)
    with pytest.raises(bitneat.BitneatError, match="names no environment"):
        bitneat.evaluate(homeless)
    assert bitneat.evaluate(homeless, 1, environment=EnvironmentSpec("BipedalWalker-v3"))
    with pytest.raises(bitneat.BitneatError, match="has 4 observations, the controller 24"):
        bitneat.evaluate(tiny, environment="CartPole-v1")


def test_saved_in_either_form_it_is_the_same(tiny: bitneat.Champion, tmp_path: Path) -> None:
    for name in ("copy.json", "copy.pkl"):
        bitneat.save(tiny, tmp_path / name)
        assert bitneat.load(tmp_path / name) == tiny
    assert (tmp_path / "copy.json").read_bytes()[:1] == b"{"
    assert inspect.signature(bitneat.load).parameters.keys() == {"path"}
    assert Encoder(tiny.controller)(np.zeros(24)).tolist() == [0] * 24
