# SPDX-License-Identifier: MIT
"""The reference against values worked out by hand."""

from __future__ import annotations

import random

import pytest

from bitneat.controller import Constant, Controller, Input, Link, Node, Reference, Signal
from bitneat.controller.reference import apply_gain, saturate
from bitneat.errors import BitneatError
from tests.strategies import input_vectors, random_controller


def one_node(node: Node, inputs: int = 2, frac_bits: int = 8) -> Reference:
    return Reference(Controller((Input(),) * inputs, (node,), (Signal(inputs),), frac_bits))


class TestOneNode:
    def test_adds_and_subtracts_its_links_and_bias(self) -> None:
        node = Node((Link(0), Link(1, sign=-1)), bias=5, activation="identity")
        assert one_node(node).step([100, 30]) == [75]

    def test_shifts_its_sources_to_the_left(self) -> None:
        node = Node((Link(0, shift=3), Link(1, shift=7, sign=-1)), activation="identity")
        assert one_node(node).step([100, 3]) == [800 - 384]
        assert one_node(node).step([-100, -3]) == [-800 + 384]

    @pytest.mark.parametrize(
        ("gain", "total", "value"),
        [
            (0, -7, -7),
            (1, -7, -14),
            (7, 3, 384),
            (-1, 7, 3),
            (-1, -7, -4),
            (-1, -1, -1),
            (-7, -1, -1),
            (-7, -128, -1),
            (-7, -129, -2),
            (-7, 127, 0),
        ],
    )
    def test_scales_by_a_power_of_two_rounding_down(self, gain: int, total: int, value: int) -> None:
        assert one_node(Node((Link(0),), gain=gain, activation="identity")).step([total, 0]) == [value]

    def test_clips_after_the_gain_and_not_before(self) -> None:
        links = (Link(0), Link(1))
        assert one_node(Node(links, activation="identity")).step([32767, 32767]) == [32767]
        assert one_node(Node(links, activation="identity")).step([-32767, -32767]) == [-32767]
        # 65534 / 2 fits: the sum itself is not clipped.
        assert one_node(Node(links, gain=-1, activation="identity")).step([32767, 32767]) == [32767]
        assert one_node(Node((Link(0), Link(1)), gain=-2, activation="identity")).step([32767, 32767]) == [16383]

    def test_never_is_minus_32768(self) -> None:
        node = Node((Link(0),), bias=-(2**30), activation="identity")
        assert one_node(node).step([-32767, 0]) == [-32767]

    @pytest.mark.parametrize(
        ("activation", "values"),
        [
            ("identity", [-300, -256, -1, 0, 1, 256, 300]),
            ("clamped", [-256, -256, -1, 0, 1, 256, 256]),
            ("relu", [0, 0, 0, 0, 1, 256, 300]),
            ("abs", [300, 256, 1, 0, 1, 256, 300]),
            ("hat", [0, 0, 255, 256, 255, 0, 0]),
            ("step", [0, 0, 0, 0, 256, 256, 256]),
        ],
    )
    def test_applies_its_activation(self, activation: str, values: list[int]) -> None:
        reference = one_node(Node((Link(0),), activation=activation), inputs=1)
        assert [reference.step([u])[0] for u in (-300, -256, -1, 0, 1, 256, 300)] == values

    def test_without_links_is_its_bias(self) -> None:
        assert one_node(Node((), bias=-20, activation="abs")).step([1, 1]) == [20]
        assert one_node(Node((), activation="gauss")).step([1, 1]) == [256]


class TestOutputs:
    def test_may_be_inputs_nodes_and_constants_and_repeat(self) -> None:
        node = Node((Link(0),), bias=1, activation="identity")
        controller = Controller((Input(),), (node,), (Signal(1), Signal(0), Constant(-5), Signal(1)))
        assert Reference(controller).step([10]) == [11, 10, -5, 11]


class TestDelayedLinks:
    def test_read_zero_first_and_then_the_step_before(self) -> None:
        reference = one_node(Node((Link(0, 1),), activation="identity"), inputs=1)
        assert [reference.step([x])[0] for x in (5, 7, -3, 0, 0)] == [0, 5, 7, -3, 0]

    def test_of_a_node_on_itself_accumulate(self) -> None:
        reference = one_node(Node((Link(0), Link(1, 1)), activation="identity"), inputs=1)
        assert [reference.step([x])[0] for x in (5, 7, -3, 32767, 1, -1)] == [5, 12, 9, 32767, 32767, 32766]

    def test_see_the_step_before_whether_the_source_stands_before_or_after(self) -> None:
        double = Node((Link(0), Link(1, 1), Link(2, 1)), activation="identity")
        after = Node((Link(1), Link(1, 1, 0, -1)), activation="identity")
        controller = Controller((Input(),), (double, after), (Signal(1), Signal(2)))
        # y1 = x + y1' + y2', y2 = y1 - y1'
        assert Reference(controller).run([[1], [0], [0], [2]]) == [[1, 1], [2, 1], [3, 1], [6, 3]]

    def test_read_the_value_and_not_the_sum(self) -> None:
        clamped = Node((Link(0),), activation="clamped")
        reader = Node((Link(1, 1),), activation="identity")
        controller = Controller((Input(),), (clamped, reader), (Signal(2),))
        assert Reference(controller).run([[9999], [0]]) == [[0], [256]]

    def test_and_undelayed_links_of_one_source_are_two_things(self) -> None:
        reference = one_node(Node((Link(0), Link(0, 1, 0, -1)), activation="identity"), inputs=1)
        assert [reference.step([x])[0] for x in (5, 7, 7, 0)] == [5, 2, 0, -7]

    def test_forget_at_reset(self) -> None:
        reference = one_node(Node((Link(0), Link(1, 1)), activation="identity"), inputs=1)
        reference.step([5])
        reference.reset()
        assert reference.step([1]) == [1]

    def test_run_starts_from_reset(self) -> None:
        for seed in range(30):
            rng = random.Random(seed)
            controller = random_controller(rng, size="small", feed_forward=False)
            sequence = input_vectors(controller, rng, 10)
            reference = Reference(controller)
            first = reference.run(sequence)
            assert reference.run(sequence) == first


class TestASmallNetwork:
    def test_by_hand(self) -> None:
        """Two inputs; n2 = clamped(4(x0 - x1)), n3 = relu(floor((n2 + x1 + 64) / 2)), n4 = abs(n3' - n2)."""
        nodes = (
            Node((Link(0), Link(1, sign=-1)), 0, 2, "clamped"),
            Node((Link(2), Link(1)), 64, -1, "relu"),
            Node((Link(3, 1), Link(2, sign=-1)), 0, 0, "abs"),
        )
        controller = Controller((Input(limit=1000),) * 2, nodes, (Signal(4), Signal(3), Signal(2)), 8)
        assert Reference(controller).run([[10, 3], [500, -500], [-500, 499], [0, 0]]) == [
            # n2 = 28; n3 = floor(95 / 2) = 47; n4 = |0 - 28|
            [28, 47, 28],
            # n2 = 256; n3 = max(0, floor(-180 / 2)) = 0; n4 = |47 - 256|
            [209, 0, 256],
            # n2 = -256; n3 = floor(307 / 2) = 153; n4 = |0 + 256|
            [256, 153, -256],
            # n2 = 0; n3 = 32; n4 = |153 - 0|
            [153, 32, 0],
        ]


class TestTheDomainIsChecked:
    def test_every_input_must_be_there(self) -> None:
        with pytest.raises(BitneatError, match=r"^step: expected 2 inputs, got 3$"):
            one_node(Node((Link(0),))).step([1, 2, 3])

    def test_an_input_is_an_integer(self) -> None:
        with pytest.raises(BitneatError, match=r"^step: expected integers, as Encoder makes them of an observation$"):
            one_node(Node((Link(0),))).step([0.5, 2])  # type: ignore[list-item]

    @pytest.mark.parametrize("x", [11, -11])
    def test_every_input_must_be_within_its_limit(self, x: int) -> None:
        controller = Controller((Input(), Input(limit=10)), (), (Signal(1),))
        assert Reference(controller).step([0, 10]) == [10]
        with pytest.raises(BitneatError, match=rf"^step: inputs\[1\] is {x}, outside its limit of ±10$"):
            Reference(controller).step([0, x])


def test_gain_and_clip_of_single_numbers() -> None:
    assert [apply_gain(-5, gain) for gain in (2, 0, -1, -2, -7)] == [-20, -5, -3, -2, -1]
    assert [saturate(v) for v in (-(2**31), -32768, -32767, 0, 32767, 32768)] == [
        -32767, -32767, -32767, 0, 32767, 32767,
    ]  # fmt: skip
