# SPDX-License-Identifier: MIT
"""Choosing among quantizations: on which seeds, by what, and what comes of the policy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from bitneat.champion import Champion, EnvironmentSpec, FloatChampion
from bitneat.controller import Controller, Input, Link, Node, Reference, Signal
from bitneat.errors import BitneatError
from bitneat.evolve import polish, quantizing
from bitneat.evolve.evaluation import Evaluator, GymnasiumEvaluator, NativeWalkerEvaluator
from bitneat.evolve.quantizing import Arena, Outcome, Request, quantize
from bitneat.evolve.randomness import REPORT_START, SELECTION_START, report_seeds
from bitneat.network import FloatNetwork, FloatNode, Policy
from bitneat.policy.arrays import read_layers
from bitneat.policy.layers import layered_network
from bitneat.quantize import spend_gains
from bitneat.sim.environment import EpisodeResult, Shaping, default_inputs, inspect
from bitneat.sim.walker.original import obstacle

CART_POLE = EnvironmentSpec("CartPole-v1")
WALKER = EnvironmentSpec("BipedalWalker-v3")
SAVED = Path(__file__).parents[1] / "quantize" / "saved" / "walker.npz"
WEIGHTS = (0.23, 0.61, 2.9, 2.1)


class Recorder:
    """An evaluator that keeps which policy ran on which seeds."""

    def __init__(self, inner: Evaluator) -> None:
        self.inner = inner
        self.runs: list[tuple[str, list[int]]] = []

    def evaluate(
        self, controllers: Sequence[Policy], seeds: Sequence[int], shaping: Shaping | None = None
    ) -> list[list[EpisodeResult]]:
        self.runs += [(policy.sha256, list(seeds)) for policy in controllers]
        return self.inner.evaluate(controllers, seeds, shaping)

    def close(self) -> None:
        self.inner.close()


@pytest.fixture(autouse=True)
def few_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quantizing, "SELECTION_EPISODES", 6)
    monkeypatch.setattr(quantizing, "_FIRST_EPISODES", 3)
    monkeypatch.setattr(quantizing, "REPORT_EPISODES", 5)
    monkeypatch.setattr(polish, "_CHILDREN", 12)
    monkeypatch.setattr(polish, "_FIRST_EPISODES", 4)


@pytest.fixture
def arena() -> Iterator[Arena]:
    info = inspect(CART_POLE)
    recorder = Recorder(GymnasiumEvaluator(CART_POLE, info.action, 120, 1))
    yield Arena(CART_POLE, info, 120, recorder)
    recorder.close()


def pole(scale: float = 1.0, offset: float = 0.0) -> FloatChampion:
    """A float policy that balances, as values of its two actions."""
    left = FloatNode(tuple((i, -w * scale) for i, w in enumerate(WEIGHTS)), offset, 1.0, "identity")
    right = FloatNode(tuple((i, w * scale) for i, w in enumerate(WEIGHTS)), offset, 1.0, "identity")
    return FloatChampion(FloatNetwork(4, (left, right), (4, 5)), inspect(CART_POLE).action, CART_POLE)


@pytest.mark.parametrize("target", ["int", "ternary"])
@pytest.mark.parametrize("method", ["round", "gains", "twn"])
def test_every_method_gives_a_champion_that_balances(arena: Arena, target: str, method: str) -> None:
    if (target, method) == ("int", "twn"):
        pytest.skip("is refused")
    outcome = quantize(pole(), Request(target, method), arena)
    assert outcome.champion.controller.is_ternary or target == "int"
    assert outcome.before is not None
    assert outcome.after is not None
    assert (outcome.before.mean, outcome.after.mean) == (120.0, 120.0)
    assert outcome.champion.provenance["quantize"]["source"]["sha256"] == pole().network.sha256
    assert outcome.champion.provenance["quantize"]["chosen"]["method"] == method
    assert outcome.champion.provenance["held_out"]["first_seed"] == REPORT_START


def test_the_report_seeds_decide_nothing(arena: Arena) -> None:
    outcome = quantize(pole(), Request("ternary", "search", generations=1), arena)
    assert isinstance(arena.evaluator, Recorder)
    reported = [(sha, seeds) for sha, seeds in arena.evaluator.runs if max(seeds) >= REPORT_START]
    expected = report_seeds(5)
    assert reported == [(pole().network.sha256, expected), (outcome.champion.controller.sha256, expected)]
    chosen = [seeds for sha, seeds in arena.evaluator.runs if sha == outcome.champion.controller.sha256]
    assert list(range(SELECTION_START, SELECTION_START + 6)) in chosen


def test_of_equals_the_smallest_is_chosen(arena: Arena) -> None:
    outcome = quantize(pole(), Request("ternary", "gains"), arena)
    sizes = [trial.to_data()["packed_bytes"] for trial in outcome.trials if trial.score and trial.score.mean == 120.0]
    assert sizes[0] == min(sizes)


def test_values_beyond_the_range_of_signals_are_scaled_into_it(arena: Arena) -> None:
    """Values of actions are sums of rewards, which are as large as they are; only their order matters."""
    outcome = quantize(pole(scale=1000.0, offset=300.0), Request("ternary", "gains"), arena)
    assert outcome.after is not None
    assert outcome.after.mean == 120.0
    # Without that, both values are the largest signal.
    inputs = default_inputs(arena.info, 8)
    saturated = spend_gains(pole(30.0, 300.0).network, inputs, 8, ternary=True, bits=5)
    assert arena.score(saturated, report_seeds(5)).mean < 60.0


def test_a_search_starts_from_the_best_and_depends_on_its_seed_alone(arena: Arena) -> None:
    lines: list[str] = []
    request = Request("ternary", "search", generations=2, seed=3)
    first = quantize(pole(), request, arena, tell=lines.append)
    second = quantize(pole(), request, arena)
    assert first.champion == second.champion
    assert first.champion.controller.is_ternary
    assert sum(line.startswith("generation ") for line in lines) == 2
    assert first.champion.provenance["quantize"]["seed"] == 3


def integer(links: tuple[Link, ...], bias: int = 0) -> Champion:
    nodes = tuple(
        Node(tuple(Link(k.source, k.delay, k.shift, k.sign * sign) for k in links), bias * sign, -3, "identity")
        for sign in (-1, 1)
    )
    controller = Controller((Input(0, 2000),) * 4, nodes, (Signal(4), Signal(5)), 8)
    return Champion(controller, inspect(CART_POLE).action, CART_POLE)


def test_an_integer_champion_becomes_ternary_without_a_change(arena: Arena) -> None:
    source = integer((Link(0, 0, 1, 1), Link(1, 0, 2, 1), Link(2, 0, 4, 1), Link(3, 0, 4, 1)), 77)
    outcome = quantize(source, Request("ternary", "gains"), arena)
    assert outcome.exact
    assert outcome.champion.controller.is_ternary
    assert outcome.before == outcome.after
    vectors = [[100, -200, 300, 2000], [-7, 1, 0, -1999]]
    assert Reference(outcome.champion.controller).run(vectors) == Reference(source.controller).run(vectors)


def test_an_integer_champion_that_has_no_equal_becomes_nearly_ternary() -> None:
    links = tuple(Link(i, 0, 7, 1) for i in range(40))
    controller = Controller((Input(),) * 40, (Node(links, 0, -7), Node(links[:1], 0, -7)), (Signal(40), Signal(41)), 8)
    outcome = quantize(Champion(controller, inspect(CART_POLE).action), Request("ternary", "gains"), None)
    assert not outcome.exact
    assert outcome.champion.controller.is_ternary
    assert outcome.champion.provenance["quantize"]["chosen"]["exact"] is False


def test_without_an_environment_the_finest_is_taken_and_nothing_scored() -> None:
    source = FloatChampion(pole().network, pole().action)
    outcome = quantize(source, Request("ternary", "gains"), None)
    assert (outcome.before, outcome.after) == (None, None)
    assert outcome.champion.provenance["quantize"]["chosen"]["bits"] == 7
    assert outcome.champion.provenance["quantize"]["chosen"]["terms"] is None


@pytest.mark.parametrize(
    ("source", "request_", "message"),
    [
        (pole, ("int", "twn"), "--method twn: makes ternary weights; --to int has gains"),
        (pole, ("octal", "twn"), "expected one of int, ternary"),
        (pole, ("ternary", "search"), "--method search: needs an environment"),
        (lambda: integer((Link(0, 0, 1, 1),)), ("int", "gains"), "holds an integer controller already"),
        (lambda: integer((Link(0),)), ("ternary", "gains"), "is ternary already"),
        (lambda: integer((Link(0, 0, 1, 1),)), ("ternary", "round"), "--method round: is for float networks"),
        (lambda: pole(scale=1e9), ("ternary", "gains"), "node 4: a weight of 2.9e.09 is too large"),
    ],
)
def test_what_cannot_be_is_said(source: object, request_: tuple[str, str], message: str) -> None:
    with pytest.raises(BitneatError, match=message):
        quantize(source(), Request(*request_), None)  # type: ignore[operator]


def test_a_network_that_does_not_fit_the_environment_is_refused(arena: Arena) -> None:
    narrow = FloatNetwork(3, (FloatNode(((0, 1.0),)),) * 2, (3, 4))
    with pytest.raises(BitneatError, match=r"has 3 inputs, CartPole-v1 gives 4"):
        quantize(FloatChampion(narrow, pole().action, CART_POLE), Request("ternary", "round"), arena)


def test_a_linear_walker_keeps_its_reward_as_a_ternary_controller() -> None:
    """The policy that an evolution strategy found, not rounded: a mean of 299 in float."""
    if (reason := obstacle(WALKER)) is not None:
        pytest.skip(reason)
    network = layered_network(read_layers(SAVED.read_bytes(), "tanh", "clamped"))
    inputs = default_inputs(inspect(WALKER), 8)
    ternary = spend_gains(network, inputs, 8, ternary=True, bits=6)
    evaluator = NativeWalkerEvaluator(WALKER, 1600, 2)
    rewards = evaluator.evaluate([network, ternary], report_seeds(24))
    before, after = (math.fsum(episode.reward for episode in row) / len(row) for row in rewards)
    assert ternary.is_ternary
    assert before > 290.0
    assert after >= 0.95 * before


def test_the_outcome_is_a_champion_like_any_other(arena: Arena) -> None:
    from bitneat.champion import dump_pickle, dumps, loads

    outcome: Outcome = quantize(pole(), Request("ternary", "twn"), arena)
    assert loads(dump_pickle(outcome.champion)) == loads(dumps(outcome.champion).encode()) == outcome.champion
