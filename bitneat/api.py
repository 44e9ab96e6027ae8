# SPDX-License-Identifier: MIT
"""What ``import bitneat`` offers: the commands as functions.

Each does what the command of its name does and returns values where that prints; whatever a caller can get wrong raises
`BitneatError`, whose message is one line.

A script that calls `evolve`, `resume` or `evaluate` for an environment that Gymnasium runs in worker processes does so under
``if __name__ == "__main__":``, as with every use of `multiprocessing`; or it asks for ``workers=1``.
"""

from __future__ import annotations

import csv
import multiprocessing
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from bitneat.champion import AnyChampion, Champion, EnvironmentSpec, load, load_any, save_json, save_pickle
from bitneat.controller import Action, Controller, Encoder, State
from bitneat.controller.packing import pack, unpack
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    import numpy.typing as npt

    from bitneat.codegen import GeneratedC, Style
    from bitneat.evolve.config import Config
    from bitneat.evolve.evaluation import Evaluator
    from bitneat.evolve.progress import Progress
    from bitneat.evolve.run_folder import RunFolder, RunSettings
    from bitneat.evolve.search import Score
    from bitneat.sim.environment import EpisodeResult
    from bitneat.verify.check import Report
    from bitneat.verify.size import SizeReport

__all__ = [
    "Agent",
    "Environment",
    "Evolved",
    "evaluate",
    "evolve",
    "generate",
    "load",
    "load_any",
    "pack",
    "resume",
    "save",
    "size",
    "unpack",
    "verify",
]

WALKER = "BipedalWalker-v3"
Environment = str | EnvironmentSpec
"""A Gymnasium id, or an `EnvironmentSpec` where there are arguments or modules to import."""


class Agent:
    """A champion that acts: observation in, action out, through the integers that the chip computes.

    Args:
        champion: as `load` returns it.
    """

    def __init__(self, champion: Champion) -> None:
        self.champion = champion
        self._encode = Encoder(champion.controller)
        self.state: State = champion.controller.new_state()
        """Every input and node after the last step."""

    def reset(self) -> None:
        """Begin an episode: delayed links forget the last one."""
        self.state = self.champion.controller.new_state()

    def act(self, observation: npt.ArrayLike) -> Any:
        """The action for an observation: what the environment's ``step`` takes.

        Raises:
            BitneatError: if a component is NaN, or there are not as many as the controller has inputs.
        """
        import numpy as np

        controller = self.champion.controller
        outputs = controller.step(self._encode(np.ravel(observation)).tolist(), self.state)
        return self.champion.action.decode(np.array(outputs, np.int16), controller.frac_bits)


@dataclass(frozen=True)
class Evolved:
    """How a run of `evolve` ended."""

    champion: Champion
    score: Score
    """Official reward over the report seeds, on which nothing was chosen."""
    folder: Path
    """The run: configuration, history, checkpoints, champion; ``evolve(resume=folder)`` goes on with it."""
    finished: bool
    """False if ``seconds`` cut it short."""

    def history(self) -> list[dict[str, float]]:
        """A row a generation: best and mean fitness, score of the leader, its links, steps; as in ``history.csv``."""
        with (self.folder / "history.csv").open(newline="") as file:
            return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def evolve(
    environment: Environment = WALKER,
    *,
    config: str | Path | Config | None = None,
    start: AnyChampion | None = None,
    population: int | None = None,
    generations: int | None = None,
    seconds: float | None = None,
    seed: int = 0,
    workers: int | None = None,
    simulator: str = "auto",
    evaluator: Evaluator | None = None,
    output: str | Path | None = None,
    progress: Progress | None = None,
) -> Evolved:
    """Evolve a controller, as ``bitneat evolve`` does; the result depends on environment, configuration and seed alone.

    Args:
        environment: a Gymnasium id or an `EnvironmentSpec`; modules that it imports must have been imported, or allowed with
            `bitneat.sim.environment.allow_imports`.
        config: a file, the name of a preset, or a `Config`; None for the preset of the environment.
        start: a champion, or a float teacher, to start from instead of from nothing.
        population: genomes a generation; None for the configuration's.
        generations: None for the configuration's.
        seconds: stop after so long; a run that this cuts short cannot be reproduced.
        seed: of all randomness, from 0.
        workers: processes or threads; None for one a core. They change no result.
        simulator: ``auto``, ``native`` or ``gymnasium``; the results are the same.
        evaluator: what runs the episodes, as `bitneat.evolve.cluster.RayEvaluator`, instead of this machine; it is left open.
        output: the run's folder; None for ``runs/ENVIRONMENT-SEED``.
        progress: told of each generation; None for silence.

    Raises:
        BitneatError: if the folder holds a run already, or the environment or a setting cannot be used.
    """
    from bitneat.evolve.config import Config, preset_for
    from bitneat.evolve.config import load as load_config
    from bitneat.evolve.randomness import MAX_SEED
    from bitneat.evolve.run_folder import RunFolder, RunSettings
    from bitneat.evolve.starting import starting_point
    from bitneat.sim.environment import inspect
    from bitneat.sim.walker.trigonometry import probe_for

    spec = _spec(environment)
    if type(seed) is not int or not 0 <= seed < MAX_SEED:
        shown = f"{seed!r:.40}" if type(seed) is not int or seed < MAX_SEED else f"of {seed.bit_length()} bits"
        raise BitneatError(f"seed: {shown}: expected an integer from 0, of at most {MAX_SEED.bit_length() - 1} bits")
    if config is None:
        config = preset_for(spec)
    settings = config if isinstance(config, Config) else load_config(str(config))
    if population is not None:
        settings = settings.with_values("NEAT", pop_size=population)
    if generations is not None:
        settings = settings.with_values("evolve", generations=generations)
    if seconds is not None and not (isinstance(seconds, int | float) and 0 < seconds < float("inf")):
        raise BitneatError(f"seconds: {seconds!r:.40}: expected a number above 0")
    path = Path(output) if output is not None else Path("runs") / f"{spec.id.replace('/', '-')}-{seed}"
    folder = RunFolder(path, _warn)
    controllers: tuple[Controller, ...] = ()
    if start is not None:
        settings, controllers = starting_point(start, settings, inspect(spec), "start")
    run = RunSettings(spec, settings, seed, seconds, trigonometry=probe_for(spec), start=controllers)
    return _carry_on(folder, run, _Means(workers, simulator, evaluator, progress), new=True)


def resume(
    folder: str | Path,
    *,
    workers: int | None = None,
    simulator: str = "auto",
    evaluator: Evaluator | None = None,
    progress: Progress | None = None,
) -> Evolved:
    """Take a run that was stopped, however, to its end: the same end as if it had not been.

    Args:
        folder: of the run; all settings come from it.
        workers: as of `evolve`.
        simulator: as of `evolve`.
        evaluator: as of `evolve`.
        progress: as of `evolve`.

    Raises:
        BitneatError: if the folder holds no run, or a damaged one.
    """
    from bitneat.evolve.run_folder import RunFolder
    from bitneat.sim.walker.trigonometry import refuse_other

    runs = RunFolder(Path(folder), _warn)
    settings = runs.settings()
    refuse_other(settings.trigonometry, str(runs.path / "run.json"))
    return _carry_on(runs, settings, _Means(workers, simulator, evaluator, progress), new=False)


@dataclass(frozen=True)
class _Means:
    """What a run is carried out with; none of it changes the result."""

    workers: int | None
    simulator: str
    evaluator: Evaluator | None
    progress: Progress | None


def _carry_on(folder: RunFolder, settings: RunSettings, means: _Means, *, new: bool) -> Evolved:
    from bitneat.evolve.run import carry_on
    from bitneat.evolve.setup import episode_limit
    from bitneat.evolve.simulators import choose, evaluator_for, recheck_for
    from bitneat.sim.environment import inspect

    _refuse_in_worker()
    spec = settings.environment
    info = inspect(spec)
    max_steps = episode_limit(settings.config, spec, info)
    chosen = choose(spec, means.simulator, _warn)
    if means.evaluator is not None:
        _refuse_other_evaluator(means.evaluator, spec, info.action, max_steps)
    evaluator = means.evaluator
    with folder.begin(settings) if new else folder.alone():
        try:
            if evaluator is None:
                evaluator, recheck = evaluator_for(chosen, means.workers, spec, info, max_steps)
            else:
                recheck = recheck_for(chosen, spec, info, max_steps)
            outcome = carry_on(folder, settings, info, evaluator, means.progress or _Silent(), check=recheck)
        finally:
            if means.evaluator is None and evaluator is not None:
                evaluator.close()
    if not isinstance(outcome.champion, Champion):
        raise BitneatError(f"{folder.champion_pickle}: is a float network; quantize it for a controller")
    return Evolved(outcome.champion, outcome.score, folder.path, outcome.finished)


def _refuse_other_evaluator(evaluator: Evaluator, spec: EnvironmentSpec, action: Action, max_steps: int) -> None:
    """Refuse one that was made for other episodes than the run's; one of the user's own need not say for which it was."""
    limit = getattr(evaluator, "max_steps", max_steps)
    if limit != max_steps:
        raise BitneatError(f"evaluator: stops episodes after {limit} steps, this run does after {max_steps}")
    found = getattr(evaluator, "spec", spec)
    if (found.id, found.kwargs) != (spec.id, spec.kwargs):
        raise BitneatError(
            f"evaluator: is for {found.id} with {dict(found.kwargs)}, this run is for {spec.id} with {dict(spec.kwargs)}"
        )
    if getattr(evaluator, "action", action) != action:
        raise BitneatError(f"evaluator: is for another action space than that of {spec.id}")


def evaluate(
    champion: Champion,
    episodes: int = 100,
    *,
    seed: int = 0,
    environment: Environment | None = None,
    max_steps: int | None = None,
    workers: int | None = None,
    simulator: str = "auto",
) -> list[EpisodeResult]:
    """Run a champion's episodes: official reward, steps and whether it ended before the time limit, an episode a seed.

    Args:
        champion: as `load` returns it.
        episodes: how many.
        seed: of the first, the next have the next ones.
        environment: None for the champion's own.
        max_steps: cut episodes short; None for the environment's own time limit.
        workers: processes or threads; None for one a core.
        simulator: ``auto``, ``native`` or ``gymnasium``; the results are the same.

    Raises:
        BitneatError: if the champion does not fit the environment.
    """
    from bitneat.evolve.simulators import choose, evaluator_for
    from bitneat.sim.environment import inspect
    from bitneat.verify.check import Settings, environment_of

    _refuse_in_worker()
    if episodes < 1 or seed < 0:
        raise BitneatError(f"episodes {episodes}, seed {seed}: expected at least one episode and a seed from 0")
    spec = environment_of(champion, Settings(environment=None if environment is None else _spec(environment)))
    info = inspect(spec)
    limits = [limit for limit in (max_steps, info.max_steps) if limit]
    if not limits:
        raise BitneatError(f"environment {spec.id}: has no time limit; give max_steps")
    evaluator, _ = evaluator_for(choose(spec, simulator, _warn), workers, spec, info, min(limits))
    try:
        return evaluator.evaluate([champion.controller], range(seed, seed + episodes))[0]
    finally:
        evaluator.close()


def generate(
    champion: Champion | Controller,
    name: str = "controller",
    style: Style | Literal["auto"] = "auto",
    *,
    guard: bool = False,
) -> GeneratedC:
    """The C of a champion, as ``bitneat codegen`` writes it; ``.source`` and ``.header`` are its text, `write` makes the files.

    Args:
        champion: or a bare controller, whose header then tells of no environment and no action.
        name: the prefix of every name in the code.
        style: ``unrolled``, ``table``, or ``auto`` for the one that compiles to fewer bytes on a Cortex-M0.
        guard: clamp the observations to their limits on entry, so that any int16 is allowed.

    Raises:
        BitneatError: if ``name`` cannot prefix C names, or there is nothing to generate.
    """
    from bitneat.codegen import generate as generate_c

    if isinstance(champion, Controller):
        return generate_c(champion, name, style, guard=guard)
    environment_id = champion.environment.id if champion.environment else ""
    return generate_c(
        champion.controller, name, style, guard=guard, action=champion.action, environment_id=environment_id
    )


def verify(
    champion: Champion,
    code: GeneratedC | str | Path | None = None,
    *,
    episodes: int = 5,
    seed: int = 0,
    targets: str | Sequence[str] | None = None,
    vectors: int | None = None,
    environment: Environment | None = None,
) -> Report:
    """Compare generated C with its champion, bit for bit, in the loop of the simulator, as ``bitneat verify`` does.

    Args:
        champion: what the C claims to be.
        code: what `generate` returned, or the path of a generated source; None to generate it for this check alone.
        episodes: in Gymnasium itself, in lock-step.
        seed: of the first episode.
        targets: names as of ``--targets``, ``"all"``, or None for the host and each chip whose tools are there.
        vectors: random inputs besides the episodes; None for as many as the command takes.
        environment: None for the champion's own.

    Returns:
        The report; ``.passed`` is the verdict, ``.failures`` say why not.

    Raises:
        BitneatError: if it cannot be tried: a tool or the environment is missing.
    """
    from bitneat.verify.cfile import CFile
    from bitneat.verify.check import THOROUGH_VECTORS, VECTORS, Settings
    from bitneat.verify.check import verify as check
    from bitneat.verify.targets import select, style_for

    names = _names(targets)
    if vectors is not None and vectors < 1:
        raise BitneatError(f"vectors: {vectors}: expected a number from 1")
    thorough = names is not None and "all" in names
    settings = Settings(
        episodes=episodes,
        seed=seed,
        environment=None if environment is None else _spec(environment),
        vectors=vectors or (THOROUGH_VECTORS if thorough else VECTORS),
    )
    if isinstance(code, str | Path):
        return check(champion, CFile.read(Path(code)), select(names), settings)
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder:
        text = generate(champion, style=style_for(names)) if code is None else code
        file = CFile.write(text, Path(folder))
        return check(champion, file, select(names), settings, handed_out=False)


def size(champion: Champion, targets: str | Sequence[str] | None = None) -> SizeReport:
    """What a champion takes, packed and compiled, as ``bitneat size`` says.

    Args:
        champion: as `load` returns it.
        targets: as of `verify`; chips that are named run the code, too, for instructions and cycles a step.
    """
    from bitneat.verify.size import measure_sizes
    from bitneat.verify.targets import select

    names = _names(targets)
    return measure_sizes(champion, select(names, run=False), speed=names is not None)


def save(champion: Champion, path: str | Path) -> None:
    """Write a champion file: JSON if the name ends in .json, else a pickle of plain data.

    Raises:
        BitneatError: if the file cannot be written.
    """
    (save_json if Path(path).suffix == ".json" else save_pickle)(champion, path)


def _names(targets: str | Sequence[str] | None) -> Sequence[str] | None:
    return [name.strip() for name in targets.split(",")] if isinstance(targets, str) else targets


def _refuse_in_worker() -> None:
    """Worker processes import the script that started them; one that evolves as it is imported would start workers without end.

    Raises:
        BitneatError: in such a process.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise BitneatError(
            "called while a worker process imports this script; put the call under: if __name__ == '__main__':"
        )


def _spec(environment: Environment) -> EnvironmentSpec:
    return EnvironmentSpec(environment) if isinstance(environment, str) else environment


def _warn(text: str) -> None:
    print(f"bitneat: {text}", file=sys.stderr)


class _Silent:
    """A progress that says nothing."""

    def start(self, search: Any, generations: int, seconds: float | None) -> None:
        """Nothing to say."""

    def generation(self, row: Any, best: Any) -> None:
        """Nothing to say."""

    def choosing(self) -> None:
        """Nothing to say."""

    def close(self) -> None:
        """Nothing to do."""
