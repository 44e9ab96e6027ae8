# SPDX-License-Identifier: MIT
"""What a reader of a page is taken to have, by what the table calls it: champions, policies from elsewhere, a sensor map."""

from __future__ import annotations

import pickle
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bitneat.champion import Champion, EnvironmentSpec, save_pickle
from bitneat.cli.main import main
from bitneat.controller import Controller, Link, Node, Signal
from bitneat.sim.environment import default_inputs, inspect
from tests.evolve.test_importing import CONFIG, make

ROOT = Path(__file__).resolve().parents[2]
WALKER = ("--env", "BipedalWalker-v3")


def _copy(source: str) -> Callable[[Path], None]:
    def copy(target: Path) -> None:
        (shutil.copytree if (ROOT / source).is_dir() else shutil.copy)(ROOT / source, target)

    return copy


def _layers(target: Path) -> None:
    """A linear policy that falls after some fifty steps, so that its episodes cost little."""
    weights = np.zeros((4, 24), np.float32)
    weights[:, 0], weights[:, 4] = 0.25, 0.5
    np.savez(target, W1=weights, b1=np.float32([-0.9, 0.9, -0.9, 0.9]))


def _float_champion(target: Path) -> None:
    layers = target.with_name("made.npz")
    _layers(layers)
    assert main(["import", str(layers), "--output-activation", "clamped", *WALKER, "-o", str(target)]) == 0


def _falling(shift: int) -> Callable[[Path], None]:
    """A controller of links worth 2^shift that falls, too; ternary if that is 1."""

    def write(target: Path) -> None:
        spec = EnvironmentSpec("BipedalWalker-v3")
        info = inspect(spec)
        nodes = tuple(Node((Link(0, shift=shift),), bias) for bias in (-256, 256, -256, 256))
        outputs = tuple(Signal(info.num_inputs + i) for i in range(len(nodes)))
        save_pickle(Champion(Controller(default_inputs(info, 8), nodes, outputs, 8), info.action, spec), target)

    return write


def _neat_configuration(target: Path) -> None:
    """For CartPole."""
    target.write_text(CONFIG.replace("num_inputs = 3", "num_inputs = 4"))


def _genome(target: Path) -> None:
    configuration = target.with_name("made.ini")
    _neat_configuration(configuration)
    genome, _ = make(configuration, 5)
    target.write_bytes(pickle.dumps(genome))


def _brief(target: Path) -> None:
    """A configuration of a search that is over soon."""
    episodes = {
        "selection_episodes": 1,
        "final_episodes": 1,
        "report_episodes": 1,
        "race_episodes": 1,
        "race_fractions": 1,
    }
    lines = [f"{key} = {value}\n" for key, value in episodes.items()]
    target.write_text("".join(["[evolve]\ngenerations = 2\n", *lines, "[NEAT]\npop_size = 4\n"]))


def _run(target: Path) -> None:
    """The folder of a short run, of a task that is over soon."""
    configuration = target.with_name("made.ini")
    _brief(configuration)
    assert main(["evolve", "--env", "CartPole-v1", "--config", str(configuration), "-o", str(target)]) == 0


def _sensor_map(target: Path) -> None:
    entries = [f"[[inputs]]\ninput = {i}\ncounts = [0, 4095]\npoints = [[0, -3.5], [4095, 3.5]]\n" for i in range(24)]
    entries += [f"[[outputs]]\noutput = {i}\nvalues = [-1, 1]\ncounts = [1000, 2000]\n" for i in range(4)]
    target.write_text("\n".join(entries))


MAKERS: dict[str, Callable[[Path], None]] = {
    "walking champion": _copy("examples/champions/tiny.pkl"),
    "falling champion": _falling(0),
    "integer champion": _falling(1),
    "float champion": _float_champion,
    "layers": _layers,
    "stable-baselines3 model": _copy("tests/policy/saved/ars_pendulum.zip"),
    "saved policies": _copy("tests/quantize/saved"),
    "neat-python configuration": _neat_configuration,
    "neat-python genome": _genome,
    "brief configuration": _brief,
    "run": _run,
    "sensor map": _sensor_map,
}
"""What there is, and how it is made."""


def put(kind: str, target: Path) -> None:
    """Make one of them."""
    target.parent.mkdir(parents=True, exist_ok=True)
    MAKERS[kind](target)
