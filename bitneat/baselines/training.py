# SPDX-License-Identifier: MIT
"""The training of a baseline from its budget to its result, in a folder that another call goes on from."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from bitneat import folders
from bitneat.baselines import checkpoint
from bitneat.baselines.actions import action_table
from bitneat.baselines.dense import dense_from_npz
from bitneat.baselines.evaluation import HeldOut, network_policy, score
from bitneat.baselines.method import Method
from bitneat.baselines.result import BaselineResult
from bitneat.baselines.settings import HARDCORE_PPO, METHODS, ArsSettings, PpoSettings, Settings
from bitneat.errors import BitneatError, MissingExtraError
from bitneat.files import read_capped, refuse_links, sole_user, write_atomic, write_json
from bitneat.version import __version__

RUN, CHECKPOINT, POLICY, RESULT, HISTORY = "baseline.json", "checkpoint.pt", "policy.npz", "result.json", "history.csv"
"""Files of a run: what it is, where it stands, and at its end the policy and its score."""

MAX_SEED = 2**29
"""Training seeds are episode seeds too, and must stay below those that policies are scored on."""

WALKERS = ("BipedalWalker-v3", "BipedalWalkerHardcore-v3")
"""What policies are trained for, and what for with ``hardcore``."""

_FORMAT, _VERSION = "bitneat-baseline", 1
_LIBRARIES = ("torch", "stable-baselines3", "sb3-contrib", "gymnasium", "numpy")
_CHECKPOINTS = 50
"""In a training, about."""
_CAP = 1 << 30


@dataclass(frozen=True)
class TrainingProgress:
    """Where a training stands."""

    method: str
    steps: int
    total: int
    episodes: int
    recent: float | None
    """Mean reward of the latest episodes as trained on, exploration and all; None before the first."""
    phase: str = "training"
    """``training`` or ``scoring``."""


def train(
    method: str,
    steps: int,
    seed: int,
    folder: str | Path,
    progress: Callable[[TrainingProgress], None] | None = None,
    *,
    settings: Settings | None = None,
    report_episodes: int = 100,
    hardcore: bool = False,
) -> BaselineResult:
    """Train a policy for BipedalWalker-v3 with a library, and score it on the report seeds.

    If ``folder`` holds the same training, begun or done, it goes on from there, or only reads the result.

    Args:
        method: ``ars``, ``ppo`` or ``dqn``.
        steps: budget in steps of the environment. Training ends after the first update that reaches it.
        seed: of all randomness.
        folder: made if it is not there.
        progress: told after every update.
        settings: of the method; `METHODS` has the defaults.
        report_episodes: to score the policy by.
        hardcore: train for BipedalWalkerHardcore-v3, which only ``ppo`` does.

    Raises:
        BitneatError: if an argument is out of range, the libraries are missing, or the folder holds something else.
    """
    if method not in METHODS:
        raise BitneatError(f"baseline: expected one of {', '.join(METHODS)}, got {method!r}")
    if hardcore and method != "ppo":
        raise BitneatError(f"baseline: hardcore is for ppo, not for {method}")
    if settings is None:
        settings = HARDCORE_PPO if hardcore else METHODS[method]()
    if not isinstance(settings, METHODS[method]):
        raise BitneatError(f"settings: expected {METHODS[method].__name__}, got {type(settings).__name__}")
    for name, value, least, most in (("steps", steps, 1, 10**12), ("seed", seed, 0, MAX_SEED)):
        if type(value) is not int or not least <= value <= most:
            raise BitneatError(f"{name}: expected a whole number in {least}..{most}, got {value!r}")
    folder = Path(folder)
    run = _run_data(method, steps, seed, settings, report_episodes, hardcore=hardcore)
    begun = _is_begun(folder, run)
    if begun and (folder / RESULT).exists():
        return load_result(folder)
    # Before the folder is made: without the libraries nothing is left behind.
    versions = {"bitneat": __version__, **_versions()}
    with _at_work(folder, run, begun=begun), _isolated():
        return _train(run, settings, folder, progress or (lambda _: None), versions)


def load_result(folder: str | Path) -> BaselineResult:
    """Read a finished training; needs no library.

    Raises:
        BitneatError: if the folder holds none, or a file of it is damaged.
    """
    folder = Path(folder)
    try:
        data = json.loads(read_capped(folder / RESULT, _CAP, regular=True))
        hidden, clipped = data["hidden"], data["system"] != "dqn"
        dense = dense_from_npz(read_capped(folder / POLICY, _CAP, regular=True), hidden, clipped)
        held_out, library = HeldOut(**data["held_out"]), HeldOut(**data["library_held_out"])
        return BaselineResult(
            data["system"],
            data["seed"],
            data["steps"],
            data["episodes"],
            dense,
            dense.to_network(),
            held_out,
            library,
            data["settings"],
            data["versions"],
        )
    except BitneatError as error:
        raise BitneatError(f"{folder}: {error}") from None
    except Exception as error:  # the file may be anyone's
        raise BitneatError(f"{folder / RESULT}: damaged: {type(error).__name__}") from None


def _train(
    run: dict[str, Any],
    settings: Settings,
    folder: Path,
    progress: Callable[[TrainingProgress], None],
    versions: dict[str, str],
) -> BaselineResult:
    from bitneat.evolve.randomness import report_seeds

    name, total = run["method"], run["steps"]
    hardcore = run.get("hardcore", False)
    method = _start(settings, total, run["seed"], hardcore=hardcore)
    try:
        rows = _restore(folder / CHECKPOINT, method)
        every = max(total // _CHECKPOINTS, 1)
        saved = method.steps
        while method.steps < total:
            method.advance()
            rows.append([method.steps, method.episodes, method.recent])
            progress(TrainingProgress(name, method.steps, total, method.episodes, method.recent))
            if method.steps - saved >= every or method.steps >= total:
                checkpoint.save(folder / CHECKPOINT, {"state": method.state(), "rows": rows})
                saved = method.steps
        progress(TrainingProgress(name, method.steps, total, method.episodes, method.recent, "scoring"))
        dense = method.dense()
        seeds = report_seeds(run["report_episodes"])
        network = dense.to_network()
        table = action_table() if name == "dqn" else None
        heldout, _ = score(network_policy(network, table), seeds, threads=1, hardcore=hardcore)
        library, _ = score(method.act, seeds, threads=1, hardcore=hardcore)
        files = method.files()
        result = BaselineResult(
            name,
            run["seed"],
            method.steps,
            method.episodes,
            dense,
            network,
            heldout,
            library,
            run["settings"],
            versions,
        )
    finally:
        method.close()
    for file, content in files.items():
        write_atomic(folder / file, content)
    _write_result(folder, result, rows, WALKERS[hardcore])
    (folder / CHECKPOINT).unlink(missing_ok=True)
    return result


def _start(settings: Settings, steps: int, seed: int, *, hardcore: bool) -> Method:
    if isinstance(settings, ArsSettings):
        from bitneat.baselines import ars

        return ars.start(settings, seed)
    if isinstance(settings, PpoSettings):
        from bitneat.baselines import ppo

        return ppo.start(settings, steps, seed, hardcore)
    from bitneat.baselines import dqn

    return dqn.start(settings, steps, seed)


def _write_result(folder: Path, result: BaselineResult, rows: list[Any], environment: str) -> None:
    write_atomic(folder / POLICY, result.dense.to_npz())
    lines = ["steps,episodes,recent_mean", *(f"{s},{e},{'' if r is None else f'{r:.3f}'}" for s, e, r in rows)]
    write_atomic(folder / HISTORY, ("\n".join(lines) + "\n").encode())
    if result.actions is None:
        _write_champion(folder, result, environment)
    # Last, since it says that all is there.
    write_json(folder / RESULT, result.to_data())


def _write_champion(folder: Path, result: BaselineResult, environment: str) -> None:
    from bitneat.champion import EnvironmentSpec, FloatChampion, save_pickle
    from bitneat.sim.walker.episodes import ACTION

    champion = FloatChampion(result.policy, ACTION, EnvironmentSpec(environment), {"baseline": result.to_data()})
    save_pickle(champion, folder / "champion.pkl")


def _run_data(
    method: str, steps: int, seed: int, settings: Settings, report_episodes: int, *, hardcore: bool
) -> dict[str, Any]:
    data = {
        "format": _FORMAT,
        "version": _VERSION,
        "method": method,
        "steps": steps,
        "seed": seed,
        "report_episodes": report_episodes,
        "settings": asdict(settings),
        **({"hardcore": True} if hardcore else {}),
    }
    plain: dict[str, Any] = json.loads(json.dumps(data))
    return plain


def _is_begun(folder: Path, run: dict[str, Any]) -> bool:
    """Whether the folder holds this training.

    Raises:
        BitneatError: if it holds another, and in what they differ; or a file that this one would write or go on from.
    """
    path = folder / RUN
    if not path.exists():
        folders.refuse_taken(folder, folders.BASELINE)
        return False
    try:
        found = json.loads(read_capped(path, 1 << 20, regular=True))
        # Trainings for the even ground do not name it.
        ours, theirs = {"hardcore": False, **run}, {"hardcore": False, **found}
        differing = [key for key in ours if theirs[key] != ours[key]]
    except BitneatError:
        raise
    except Exception as error:  # the file may be anyone's
        raise BitneatError(f"{path}: damaged: {type(error).__name__}") from None
    if differing:
        key = differing[0]
        raise BitneatError(
            f"{folder}: holds another training, whose {key} is {theirs[key]!r:.60}, not {ours[key]!r:.60}; give another folder"
        )
    return True


@contextmanager
def _at_work(folder: Path, run: dict[str, Any], *, begun: bool) -> Iterator[None]:
    """Be the only process at work in a training's folder, new or not."""
    if begun:
        refuse_links(folder)
        with sole_user(folder):
            yield
        return
    with folders.begun(folder, folders.BASELINE):
        write_json(folder / RUN, run)
        yield


def _restore(path: Path, method: Method) -> list[Any]:
    rows: list[Any] = []

    def take(data: Any) -> None:
        method.restore(data["state"])
        rows.extend(data["rows"])

    checkpoint.restore(path, take)
    return rows


def _versions() -> dict[str, str]:
    try:
        import sb3_contrib  # noqa: F401
        import stable_baselines3  # noqa: F401
        import torch  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            f"baseline: {error.name or 'a library'} is not installed; pip install 'bitneat[baselines]'"
        ) from None
    return {name: metadata.version(name) for name in _LIBRARIES}


@contextmanager
def _isolated() -> Iterator[None]:
    """One thread of PyTorch, and the caller's own random numbers afterwards as they were."""
    import torch

    threads = torch.get_num_threads()
    states = random.getstate(), np.random.get_state(), torch.get_rng_state()  # noqa: NPY002 - the libraries draw from it
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        random.setstate(states[0])
        np.random.set_state(states[1])  # noqa: NPY002
        torch.set_rng_state(states[2])
