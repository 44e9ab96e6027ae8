# SPDX-License-Identifier: MIT
"""Random controllers and input vectors for tests: seeded generators, and Hypothesis strategies that shrink.

`random_controller` makes rich controllers from a `random.Random`; a failure is replayed from its seed. `controllers` draws
from the same space in a structured way and shrinks towards few nodes, few links and plain values. Both give valid ones only.
"""

from __future__ import annotations

import random
from collections.abc import Sequence

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from bitneat.controller import ACTIVATION_NAMES, Constant, Controller, Input, Link, Node, Output, Signal
from bitneat.controller.activation import output_limit
from bitneat.controller.ir import ACCUMULATOR_MAX, FRAC_BITS_RANGE, GAIN_RANGE, SCALE_RANGE, SHIFT_RANGE, SIGNAL_MAX

patient = settings(suppress_health_check=[HealthCheck.too_slow])
"""The settings of the profile for a test that draws controllers, which takes its time on a busy machine."""

SIZES = ("small", "medium", "large")
"""``small`` has a few nodes, ``medium`` looks like an evolved walker, ``large`` has more than 64 signals."""


def random_controller(
    rng: random.Random,
    *,
    size: str | None = None,
    ternary: bool | None = None,
    feed_forward: bool | None = None,
    activations: Sequence[str] = ACTIVATION_NAMES,
    frac_bits: int | None = None,
    num_inputs: int | None = None,
    num_nodes: int | None = None,
    num_outputs: int | None = None,
    max_fan_in: int = 64,
) -> Controller:
    """A valid controller; an option left at None is drawn too.

    Args:
        rng: the only source of randomness: equal states give equal controllers.
        size: one of `SIZES`.
        ternary: every weight ±1, every bias 0 or ±One.
        feed_forward: no delayed link.
        activations: those to draw from.
        frac_bits: F.
        num_inputs: overrides what ``size`` would draw, as do ``num_nodes`` and ``num_outputs``.
        num_nodes: 0 is allowed: outputs are then inputs and constants.
        num_outputs: at least 1.
        max_fan_in: most links of a node.
    """
    size = size or rng.choices(SIZES, (6, 3, 1))[0]
    ternary = rng.random() < 0.4 if ternary is None else ternary
    feed_forward = rng.random() < 0.5 if feed_forward is None else feed_forward
    frac_bits = rng.randint(*FRAC_BITS_RANGE) if frac_bits is None else frac_bits
    most_inputs, nodes_range = {"small": (5, (0, 8)), "medium": (24, (6, 40)), "large": (80, (40, 100))}[size]
    num_inputs = rng.randint(1, most_inputs) if num_inputs is None else num_inputs
    num_nodes = rng.randint(*nodes_range) if num_nodes is None else num_nodes
    num_outputs = rng.randint(1, 6) if num_outputs is None else num_outputs
    if size == "large":
        num_nodes = max(num_nodes, 65 - num_inputs) if num_nodes else 0

    one = 1 << frac_bits
    inputs = _random_inputs(rng, num_inputs, one)
    kinds = [rng.choice(activations) for _ in range(num_nodes)]
    limits = [entry.limit for entry in inputs] + [output_limit(kind, frac_bits) for kind in kinds]
    total = num_inputs + num_nodes

    def random_link(index: int) -> Link:
        delayed = not feed_forward and rng.random() < 0.25
        if delayed:
            source = index if rng.random() < 0.2 else rng.randrange(total)
        else:
            # The newest half is preferred, so that networks get deep.
            source = rng.randrange(index // 2, index) if rng.random() < 0.5 else rng.randrange(index)
        shift = 0 if ternary or rng.random() < 0.5 else rng.randint(*SHIFT_RANGE)
        return Link(source, int(delayed), shift, rng.choice((-1, 1)))

    def random_bias() -> int:
        kind = rng.random()
        if kind < 0.5:
            return 0
        if ternary or kind < 0.7:
            return rng.choice((-one, one))
        return rng.choice((rng.randint(-2 * one, 2 * one), rng.randint(-40000, 40000), rng.choice((-1, 1)) << 30))

    nodes: list[Node] = []
    for position, activation in enumerate(kinds):
        index = num_inputs + position
        kind = rng.random()
        if kind < 0.06 and nodes:  # a twin of an earlier node, for the passes to merge
            twin = rng.randrange(position)
            kinds[position] = nodes[twin].activation
            limits[index] = limits[num_inputs + twin]
            nodes.append(nodes[twin])
            continue
        if kind < 0.16:  # a plain forwarder, or nearly one
            nodes.append(Node((random_link(index),), 0, rng.choice((0, 0, 0, 1, -1)), activation))
            continue
        fan_in = min(max_fan_in, _random_fan_in(rng, max_fan_in))
        links: dict[tuple[int, int, int], Link] = {}
        for _ in range(4 * fan_in):  # small networks have fewer distinct links than that, so give up in time
            if len(links) < fan_in:
                link = random_link(index)
                links[link.source, link.delay, link.shift] = link
        gain = 0 if rng.random() < 0.4 else rng.randint(*GAIN_RANGE)
        nodes.append(Node(tuple(links.values()), random_bias(), gain, activation))
    # A twin may have changed the limit of a later source of a delayed link, so the sums are fitted at the end.
    nodes = [fitted(node, limits, frac_bits) for node in nodes]

    def random_output() -> Output:
        kind = rng.random()
        if kind < 0.06:
            return Constant(rng.choice((0, one, -one, SIGNAL_MAX, -SIGNAL_MAX, rng.randint(-SIGNAL_MAX, SIGNAL_MAX))))
        if kind < 0.15 or not nodes:
            return Signal(rng.randrange(total))
        return Signal(rng.randrange(max(num_inputs, total - 3 * num_outputs), total))

    return Controller(inputs, tuple(nodes), tuple(random_output() for _ in range(num_outputs)), frac_bits)


def _random_inputs(rng: random.Random, count: int, one: int) -> tuple[Input, ...]:
    style = rng.choice(("default", "uniform", "each"))

    def limit() -> int:
        return rng.choice((1, one - 1, one, one + 1, 5 * one, SIGNAL_MAX, rng.randint(1, SIGNAL_MAX)))

    def clipped(value: int) -> int:
        return max(1, min(SIGNAL_MAX, value))

    if style == "default":
        return (Input(),) * count
    if style == "uniform":
        return (Input(rng.randint(-3, 3), clipped(limit())),) * count
    return tuple(Input(rng.randint(*SCALE_RANGE), clipped(limit())) for _ in range(count))


def _random_fan_in(rng: random.Random, most: int) -> int:
    kind = rng.random()
    if kind < 0.05:
        return 0
    if kind < 0.85:
        return rng.randint(1, 6)
    return rng.choice((most, rng.randint(1, most)))


def fitted(node: Node, limits: Sequence[int], frac_bits: int) -> Node:
    """The node with its gain lowered, then its bias cut, then links dropped until the accumulator rule holds.

    A bias that is cut is 0 if it was ±One, so that a ternary node stays ternary.
    """
    links = list(node.links)
    while sum(limits[link.source] << link.shift for link in links) > ACCUMULATOR_MAX:
        links.pop()
    total = sum(limits[link.source] << link.shift for link in links)
    gain, bias = node.gain, node.bias
    while gain > 0 and (total + min(abs(bias), 1 << frac_bits)) << gain > ACCUMULATOR_MAX:
        gain -= 1
    room = (ACCUMULATOR_MAX >> max(gain, 0)) - total
    if abs(bias) > room:
        bias = 0 if abs(bias) == 1 << frac_bits else max(-room, min(room, bias))
    return Node(tuple(links), bias, gain, node.activation)


def input_vectors(controller: Controller, rng: random.Random, count: int) -> list[list[int]]:
    """``count`` vectors in the declared domain; extremes first, if there is room, then mixtures of all kinds.

    They serve as independent vectors and as one sequence of steps.
    """
    one = controller.one
    limits = [entry.limit for entry in controller.inputs]
    marks = (0, 1, one - 1, one, one + 1, SIGNAL_MAX)

    def within(values: Sequence[int]) -> list[int]:
        return [max(-limit, min(limit, value)) for value, limit in zip(values, limits, strict=True)]

    def mixed() -> list[int]:
        return within([rng.choice((-1, 1)) * rng.choice(marks) for _ in limits])

    def uniform() -> list[int]:
        return [rng.randint(-limit, limit) for limit in limits]

    def near_zero() -> list[int]:
        return within([round(rng.gauss(0.0, one)) for _ in limits])

    def blended() -> list[int]:
        return [rng.choice(choice) for choice in zip(mixed(), uniform(), near_zero(), strict=True)]

    vectors = [
        [0] * len(limits),
        limits[:],
        [-limit for limit in limits],
        [limit if i % 2 else -limit for i, limit in enumerate(limits)],
        *(within([sign * mark] * len(limits)) for mark in marks[1:-1] for sign in (1, -1)),
    ][:count]
    makers = (mixed, uniform, near_zero, blended)
    while len(vectors) < count:
        vectors.append(rng.choice(makers)())
    return vectors


@st.composite
def controllers(
    draw: st.DrawFn,
    *,
    ternary: bool = False,
    feed_forward: bool = False,
    max_inputs: int = 4,
    max_nodes: int = 8,
    max_outputs: int = 4,
    max_links: int = 6,
    activations: Sequence[str] = ACTIVATION_NAMES,
) -> Controller:
    """Valid controllers that shrink towards one input, no node, F = 4 and links of weight +1 without delay."""
    frac_bits = draw(st.integers(*FRAC_BITS_RANGE))
    one = 1 << frac_bits
    limits_of_inputs = st.one_of(
        st.integers(1, SIGNAL_MAX), st.sampled_from((SIGNAL_MAX, one, min(5 * one, SIGNAL_MAX), 1))
    )
    scales = st.integers(-4, 4)
    inputs = tuple(draw(st.lists(st.builds(Input, scales, limits_of_inputs), min_size=1, max_size=max_inputs)))
    kinds = draw(st.lists(st.sampled_from(activations), max_size=max_nodes))
    total = len(inputs) + len(kinds)
    limits = [entry.limit for entry in inputs] + [output_limit(kind, frac_bits) for kind in kinds]
    signs = st.sampled_from((1, -1))
    shifts = st.just(0) if ternary else st.sampled_from((0, 0, 0, *range(1, SHIFT_RANGE[1] + 1)))
    biases = st.sampled_from((0, one, -one))
    if not ternary:
        biases = st.one_of(biases, st.integers(-3 * one, 3 * one), st.integers(-ACCUMULATOR_MAX, ACCUMULATOR_MAX))
    gains = st.one_of(st.just(0), st.integers(*GAIN_RANGE))
    nodes = []
    for index, activation in enumerate(kinds, start=len(inputs)):
        links = st.builds(Link, st.integers(0, index - 1), st.just(0), shifts, signs)
        if not feed_forward:
            links = st.one_of(links, links, st.builds(Link, st.integers(0, total - 1), st.just(1), shifts, signs))
        drawn = draw(st.lists(links, max_size=max_links, unique_by=lambda link: (link.source, link.delay, link.shift)))
        node = Node(tuple(drawn), draw(biases), draw(gains), activation)
        nodes.append(fitted(node, limits, frac_bits))
    outputs = st.one_of(
        st.builds(Signal, st.integers(0, total - 1).map(lambda i: total - 1 - i)),
        st.builds(Constant, st.integers(-SIGNAL_MAX, SIGNAL_MAX)),
    )
    return Controller(inputs, tuple(nodes), tuple(draw(st.lists(outputs, min_size=1, max_size=max_outputs))), frac_bits)


@st.composite
def controllers_with_inputs(
    draw: st.DrawFn, *, max_steps: int = 8, **options: object
) -> tuple[Controller, list[list[int]]]:
    """A controller and a sequence of input vectors in its domain."""
    controller = draw(controllers(**options))  # type: ignore[arg-type]
    one = controller.one
    vectors = st.tuples(
        *(
            st.one_of(
                st.integers(-entry.limit, entry.limit),
                st.sampled_from((0, entry.limit, -entry.limit, min(one, entry.limit), -min(one, entry.limit))),
            )
            for entry in controller.inputs
        )
    ).map(list)
    return controller, draw(st.lists(vectors, min_size=1, max_size=max_steps))
