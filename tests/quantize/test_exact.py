# SPDX-License-Identifier: MIT
"""An integer controller and its ternary equal give the same bits, for every sequence."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings

from bitneat.controller import Controller, Input, Link, Node, Reference, Signal
from bitneat.controller.passes import optimize
from bitneat.errors import BitneatError
from bitneat.quantize import to_ternary
from tests.strategies import controllers_with_inputs, input_vectors

SIX = (Input(0, 1000),) * 6


@settings(deadline=None, max_examples=150)
@given(controllers_with_inputs())
def test_the_ternary_equal_gives_the_same_bits(case: tuple[Controller, list[list[int]]]) -> None:
    controller, vectors = case
    try:
        ternary = to_ternary(controller)
    except BitneatError as error:
        assert "1024" in str(error) or "too large" in str(error) or "accumulator" in str(error)
        return
    assert ternary.is_ternary
    assert Reference(ternary).run(vectors) == Reference(controller).run(vectors)
    assert to_ternary(ternary) == ternary


def controller(rng: random.Random, *, frac_bits: int = 8) -> Controller:
    """Shifts, biases and gains as an imported policy has them."""
    nodes = []
    for index in range(6, 10):
        links = {}
        for _ in range(8):
            source, shift = rng.randrange(index), rng.randint(0, 5)
            links[source, shift] = Link(source, rng.choice((0, 0, 0, 1)), shift, rng.choice((-1, 1)))
        nodes.append(Node(tuple(sorted(links.values())), rng.randint(-3000, 3000), rng.randint(-5, 0), "clamped"))
    return Controller(SIX, tuple(nodes), (Signal(8), Signal(9)), frac_bits)


@pytest.mark.parametrize("frac_bits", [4, 8, 12])
def test_policies_of_ordinary_size_always_have_an_equal(frac_bits: int) -> None:
    for seed in range(30):
        rng = random.Random(seed)
        original = controller(rng, frac_bits=frac_bits)
        ternary = to_ternary(original)
        assert ternary.is_ternary
        vectors = input_vectors(original, rng, 60)
        assert Reference(ternary).run(vectors) == Reference(original).run(vectors), f"seed {seed}"
        small = optimize(ternary)
        assert small.is_ternary
        assert Reference(small).run(vectors) == Reference(original).run(vectors), f"seed {seed}"


def test_a_helper_that_could_saturate_is_divided() -> None:
    wide = (Input(0, 32767),) * 3
    node = Node((Link(0, 0, 2, 1), Link(1, 0, 2, -1), Link(2, 0, 1, 1)), 0, -3, "identity")
    original = Controller(wide, (node,), (Signal(3),), 8)
    vectors = [[32767, -32767, 32767], [32767, 32767, -5], [-32767, 17, 0], [8191, 8191, 8191]]
    assert Reference(to_ternary(original)).run(vectors) == Reference(original).run(vectors)
    inexact = to_ternary(original, exact=False)
    assert inexact.is_ternary
    assert len(inexact.nodes) < len(to_ternary(original).nodes)
    assert Reference(inexact).run(vectors[3:]) == Reference(original).run(vectors[3:])
    assert Reference(inexact).run(vectors[:1]) != Reference(original).run(vectors[:1])


def test_biases_larger_than_a_signal_are_exact() -> None:
    for bias in (2**14, 2**15 + 2**17 - 3, -(2**15) - 2**14 + 1, 40000, -123457):
        node = Node((Link(0), Link(0, 0, 1, -1)), bias, -4, "identity")
        original = Controller((Input(0, 32767),), (node,), (Signal(1),), 8)
        vectors = [[-32767], [0], [1000], [32767]]
        assert Reference(to_ternary(original)).run(vectors) == Reference(original).run(vectors)


def test_a_bias_that_only_saturates_further_costs_no_more_than_it_needs() -> None:
    node = Node((Link(0),), 2**31 - 2000, 0, "identity")
    original = Controller((Input(0, 1000),), (node,), (Signal(1),), 8)
    vectors = [[-1000], [0], [1000]]
    ternary = to_ternary(original)
    assert Reference(ternary).run(vectors) == Reference(original).run(vectors) == [[32767]] * 3
    assert len(ternary.nodes) < 12


def test_what_would_take_too_many_links_is_refused() -> None:
    links = tuple(Link(i, 0, 7, 1) for i in range(40))
    original = Controller((Input(),) * 40, (Node(links, 0, -7),), (Signal(40),), 8)
    with pytest.raises(BitneatError, match="node 40: needs more than 1024 links of weight 1"):
        to_ternary(original)
    assert to_ternary(original, exact=False).is_ternary
