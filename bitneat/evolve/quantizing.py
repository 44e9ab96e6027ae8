# SPDX-License-Identifier: MIT
"""Choosing among the ways in which `bitneat.quantize` makes a controller: by what they are worth in the environment.

All candidates run some episodes of the selection seeds, the best of them more; what is chosen is reported on the report seeds,
which decide nothing. ``search`` then goes on from the best by small changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from bitneat.champion import AnyChampion, Champion, EnvironmentSpec, FloatChampion
from bitneat.controller import Controller, DiscreteAction, Input
from bitneat.controller.ir import SIGNAL_MAX
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import Evaluator
from bitneat.evolve.polish import Goal, Polish
from bitneat.evolve.randomness import REPORT_START, SELECTION_START, report_seeds, selection_seeds
from bitneat.evolve.search import Score
from bitneat.network import FloatNetwork, Policy
from bitneat.quantize import QuantizeError, round_weights, spend_gains, threshold_weights, to_ternary
from bitneat.quantize.scaling import rescaled
from bitneat.sim.environment import EnvironmentInfo, EpisodeRunner, default_inputs, one_limit
from bitneat.version import __version__

METHODS = ("round", "twn", "gains", "search")
TARGETS = ("int", "ternary")
REPORT_EPISODES = 100
SELECTION_EPISODES = 64
DEFAULT_GENERATIONS = 60

_BITS = (1, 2, 3, 4, 5, 6, 7)
_TERMS = (1, 2, None)
_FIRST_EPISODES = 16
_GO_ON = 6
_START = 4
"""Candidates that a search starts from."""
_PEAK_EPISODES = 4
_HEADROOM = 4.0


@dataclass(frozen=True)
class Variant:
    """A controller and how it was made, as plain data."""

    controller: Controller
    how: Mapping[str, Any]

    def __str__(self) -> str:
        return " ".join(f"{key} {value}" if key != "method" else str(value) for key, value in self.how.items())


@dataclass(frozen=True)
class Trial:
    """A candidate's score on the selection seeds; None if there is no environment."""

    candidate: Variant
    score: Score | None

    def to_data(self) -> dict[str, Any]:
        """As plain data."""
        controller = self.candidate.controller
        return {
            **self.candidate.how,
            "links": controller.num_links,
            "nodes": len(controller.nodes),
            "packed_bytes": len(pack(controller)),
            "selection": None if self.score is None else self.score.to_data(),
        }


@dataclass(frozen=True)
class Request:
    """What is asked for.

    ``frac_bits`` is F, of the controller made from a float network. ``generations`` and ``seed`` are those of ``search``.
    """

    target: str
    method: str
    frac_bits: int = 8
    generations: int = DEFAULT_GENERATIONS
    seed: int = 0

    def __post_init__(self) -> None:
        if self.target not in TARGETS or self.method not in METHODS:
            raise BitneatError(f"quantize: expected one of {', '.join(TARGETS)} and one of {', '.join(METHODS)}")
        if (self.target, self.method) == ("int", "twn"):
            raise QuantizeError(
                "--method twn: makes ternary weights; --to int has gains, which takes a scale for each node, too"
            )


@dataclass(frozen=True)
class Outcome:
    """A champion, and how it compares with its source on the report seeds (None without an environment)."""

    champion: Champion
    before: Score | None
    after: Score | None
    trials: tuple[Trial, ...]
    """What was tried, the chosen one first."""
    exact: bool
    """Whether the champion computes exactly what the source does."""


class Arena:
    """The environment of a champion, and what runs episodes in it."""

    def __init__(self, spec: EnvironmentSpec, info: EnvironmentInfo, max_steps: int, evaluator: Evaluator) -> None:
        self.spec, self.info, self.max_steps, self.evaluator = spec, info, max_steps, evaluator

    def score(self, policy: Policy, seeds: Sequence[int]) -> Score:
        """The official rewards."""
        return Score.of(self.evaluator.evaluate([policy], seeds)[0])

    def peaks(self, network: FloatNetwork) -> list[float]:
        """The largest size that each node's value reaches in a few episodes of the selection seeds."""
        watched = _Watched(network)
        run = EpisodeRunner(self.spec, network, self.info.action, watched, "auto")
        for seed in selection_seeds(_PEAK_EPISODES):
            run(seed, self.max_steps)
        return watched.peaks


class _Watched:
    """A network that runs, and takes note of the largest size of each node's value."""

    def __init__(self, network: FloatNetwork) -> None:
        first = network.num_inputs
        self._everything = replace(network, outputs=tuple(range(first, first + len(network.nodes))))
        self._outputs = network.outputs
        self.peaks = [0.0] * len(network.nodes)

    def reset(self) -> None:
        """Nothing to forget."""

    def step(self, inputs: Any) -> list[float]:
        """The outputs for an observation."""
        observation = [float(value) for value in inputs]
        values = self._everything.step(observation)
        self.peaks = [max(peak, abs(value)) for peak, value in zip(self.peaks, values, strict=True)]
        signals = observation + values
        return [signals[index] for index in self._outputs]


def quantize(
    source: AnyChampion, request: Request, arena: Arena | None, *, tell: Callable[[str], None] = lambda _: None
) -> Outcome:
    """Make a controller of a float champion, or a ternary one of an integer champion, and choose how where there are ways.

    Without an environment there is nothing to choose by: then it is the finest of the candidates, and nothing is scored.

    Args:
        source: what to quantize.
        request: to what, and how.
        arena: the source's environment, or None.
        tell: is called with a line of progress now and then.

    Raises:
        BitneatError: if there is no such controller, or an episode fails.
    """
    if request.method == "search" and arena is None:
        raise QuantizeError("--method search: needs an environment to search in, and the champion names none")
    candidates = list(_candidates(source, request, arena))
    if arena is None:
        trials = [Trial(candidates[-1], None)]
    else:
        trials = _choose(candidates, arena, tell)
        if request.method == "search":
            trials = _search(trials, request, arena, tell)
    chosen = trials[0]
    policy = source.controller if isinstance(source, Champion) else source.network
    before = after = None
    if arena is not None:
        tell(f"scoring the source and the controller on {REPORT_EPISODES} report seeds")
        before = arena.score(policy, report_seeds(REPORT_EPISODES))
        after = arena.score(chosen.candidate.controller, report_seeds(REPORT_EPISODES))
    provenance = {
        "tool": f"bitneat {__version__}",
        "quantize": {
            "source": {
                "kind": "integer" if isinstance(source, Champion) else "float",
                "sha256": policy.sha256,
                "provenance": dict(source.provenance),
                "held_out": None if before is None else {**before.to_data(), "first_seed": REPORT_START},
            },
            "to": request.target,
            "method": request.method,
            "chosen": dict(chosen.candidate.how),
            **({"generations": request.generations, "seed": request.seed} if request.method == "search" else {}),
        },
        "selection": None if chosen.score is None else {**chosen.score.to_data(), "first_seed": SELECTION_START},
        "held_out": None if after is None else {**after.to_data(), "first_seed": REPORT_START},
        "max_steps": None if arena is None else arena.max_steps,
    }
    champion = Champion(chosen.candidate.controller, source.action, source.environment, provenance)
    return Outcome(champion, before, after, tuple(trials), chosen.candidate.how.get("exact") is True)


def _candidates(source: AnyChampion, request: Request, arena: Arena | None) -> Iterator[Variant]:
    """Without repetitions, the finest last."""
    made = _of_integers(source, request) if isinstance(source, Champion) else _of_floats(source, request, arena)
    known: set[str] = set()
    failure: BitneatError | None = None
    for make_one, how in made:
        try:
            controller = make_one()
        except QuantizeError as error:
            failure = failure or error
            continue
        if controller.sha256 not in known:
            known.add(controller.sha256)
            yield Variant(controller, how)
    if not known:
        raise failure or QuantizeError("there is no such controller")


_Made = Iterator[tuple[Callable[[], Controller], Mapping[str, Any]]]


def _of_integers(source: Champion, request: Request) -> _Made:
    controller = source.controller
    if request.target == "int":
        raise QuantizeError("holds an integer controller already; --to ternary makes it ternary")
    if controller.is_ternary:
        raise QuantizeError("is ternary already; to make it better or smaller there is `bitneat polish`")
    if request.method in ("round", "twn"):
        raise QuantizeError(
            f"--method {request.method}: is for float networks; an integer controller takes gains or search"
        )
    try:
        exact = to_ternary(controller)
        yield lambda: exact, {"method": "gains", "exact": True}
    except QuantizeError:
        yield lambda: to_ternary(controller, exact=False), {"method": "gains", "exact": False}


def _of_floats(source: FloatChampion, request: Request, arena: Arena | None) -> _Made:
    plain, scaled = _inputs(source.network, request.frac_bits, arena)
    ternary, frac_bits = request.target == "ternary", request.frac_bits
    network = source.network
    if request.method in ("round", "search"):
        yield (
            lambda: round_weights(source.network, plain, frac_bits, ternary=ternary),
            {"method": "round", "frac_bits": frac_bits},
        )
    if arena is not None and request.method != "round":
        peaks = arena.peaks(network)
        if max(peaks, default=0.0) * 2**frac_bits > SIGNAL_MAX / _HEADROOM:
            largest = SIGNAL_MAX / _HEADROOM / 2**frac_bits
            network = rescaled(network, peaks, largest, only_order=isinstance(source.action, DiscreteAction))
    if request.method in ("twn", "search") and ternary:
        for inputs in {plain: 0, scaled: 0}:
            yield (
                lambda inputs=inputs: threshold_weights(network, inputs, frac_bits),  # type: ignore[misc]
                {"method": "twn", "frac_bits": frac_bits, "inputs": "plain" if inputs == plain else "scaled"},
            )
    if request.method in ("gains", "search"):
        for terms in _TERMS:
            for bits in _BITS:
                yield (
                    lambda bits=bits, terms=terms: spend_gains(  # type: ignore[misc]
                        network, scaled, frac_bits, ternary=ternary, bits=bits, terms=terms
                    ),
                    {"method": "gains", "frac_bits": frac_bits, "bits": bits, "terms": terms},
                )


def _inputs(network: FloatNetwork, frac_bits: int, arena: Arena | None) -> tuple[tuple[Input, ...], tuple[Input, ...]]:
    """Observations as they are, and scaled as their bounds suggest."""
    if arena is None:
        plain = (Input(),) * network.num_inputs
        return plain, plain
    if arena.info.num_inputs != network.num_inputs:
        raise QuantizeError(f"has {network.num_inputs} inputs, {arena.spec.id} gives {arena.info.num_inputs}")
    plain = default_inputs(arena.info, frac_bits, (0,) * network.num_inputs)
    return plain, one_limit(default_inputs(arena.info, frac_bits))


def _choose(candidates: Sequence[Variant], arena: Arena, tell: Callable[[str], None]) -> list[Trial]:
    """All of them, the chosen one first."""
    if len(candidates) > _GO_ON:
        first = _trials(candidates, arena, _FIRST_EPISODES, tell)
        finalists = [trial.candidate for trial in first[:_GO_ON]]
        return _smallest_first(_trials(finalists, arena, SELECTION_EPISODES, tell)) + first[_GO_ON:]
    return _smallest_first(_trials(candidates, arena, SELECTION_EPISODES, tell))


def _trials(candidates: Sequence[Variant], arena: Arena, episodes: int, tell: Callable[[str], None]) -> list[Trial]:
    trials = []
    for number, candidate in enumerate(candidates, start=1):
        score = arena.score(candidate.controller, selection_seeds(episodes))
        trials.append(Trial(candidate, score))
        tell(f"candidate {number} of {len(candidates)}, {candidate}: {score.mean:.1f} over {episodes} episodes")
    return sorted(trials, key=_order)


def _smallest_first(trials: Sequence[Trial]) -> list[Trial]:
    """The smallest of those that cannot be told from the best, within its standard error, and then the others in their order.

    What counts is the mean less one standard error: a walker that falls now and then has a large one, and is not the better for it.
    """
    least = _sure(trials[0]) - _error(trials[0])
    equal = [trial for trial in trials if _sure(trial) >= least]
    chosen = min(equal, key=lambda trial: (len(pack(trial.candidate.controller)), _order(trial)))
    return [chosen, *(trial for trial in trials if trial is not chosen)]


def _error(trial: Trial) -> float:
    """Standard error of the mean."""
    assert trial.score is not None
    return trial.score.std / math.sqrt(trial.score.episodes)


def _sure(trial: Trial) -> float:
    """The mean less one standard error."""
    assert trial.score is not None
    return trial.score.mean - _error(trial)


def _order(trial: Trial) -> tuple[float, int, str]:
    controller = trial.candidate.controller
    return -_sure(trial), len(pack(controller)), controller.sha256


def _search(trials: list[Trial], request: Request, arena: Arena, tell: Callable[[str], None]) -> list[Trial]:
    starts = [trial.candidate for trial in trials[:_START]]
    polish = Polish([start.controller for start in starts], Goal(), request.seed)
    while polish.generation < request.generations:
        row = polish.advance(arena.evaluator)
        tell(
            f"generation {row.generation} of {request.generations}: best {row.best:.1f} in {row.best_bytes} bytes,"
            f" {row.episodes} episodes"
        )
    started = {start.controller.sha256 for start in starts}
    how = {"method": "search", "generations": request.generations, "seed": request.seed, "from": str(starts[0])}
    found = [Variant(entry.controller, how) for entry in polish.ranking() if entry.controller.sha256 not in started]
    # The start itself stays in the choice: what is chosen is at most a standard error of the best below the best of them, by the
    # mean less one standard error on the selection seeds. It may be worse there than the start, if it is smaller.
    finalists = sorted([*_trials(found[:_GO_ON], arena, SELECTION_EPISODES, tell), *trials[:1]], key=_order)
    return _smallest_first(finalists) + trials[1:]
