# SPDX-License-Identifier: MIT
from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bitneat.controller import ACTIVATION_NAMES, Controller, Input, Link, Node, Reference, Signal
from bitneat.controller.activation import table
from bitneat.controller.interval import Interval, image, intervals
from bitneat.controller.ir import FRAC_BITS_RANGE, SIGNAL_MAX
from bitneat.controller.reference import apply_gain, saturate
from tests.strategies import controllers_with_inputs, input_vectors, patient, random_controller


def single(node: Node, *limits: int, frac_bits: int = 8) -> Controller:
    """One node over inputs with these limits."""
    return Controller(tuple(Input(limit=limit) for limit in limits), (node,), (Signal(len(limits)),), frac_bits)


def assert_sound(controller: Controller, sequence: list[list[int]]) -> None:
    bounds = intervals(controller)
    reference = Reference(controller)
    previous = [0] * controller.num_signals
    for inputs in sequence:
        reference.step(inputs)
        for index, value in enumerate(reference.signals):
            low, high = bounds.signals[index]
            assert low <= value <= high, f"signal {index} is {value}, outside {low}..{high} of {controller}"
        for node, node_bounds in zip(controller.nodes, bounds.nodes, strict=True):
            accumulator = node.bias + sum(
                link.sign * ((previous if link.delay else reference.signals)[link.source] << link.shift)
                for link in node.links
            )
            scaled = apply_gain(accumulator, node.gain)
            assert node_bounds.accumulator.low <= accumulator <= node_bounds.accumulator.high
            assert node_bounds.scaled.low <= scaled <= node_bounds.scaled.high
            assert node_bounds.argument.low <= saturate(scaled) <= node_bounds.argument.high
        previous = list(reference.signals)


class TestImage:
    @pytest.mark.parametrize("frac_bits", range(FRAC_BITS_RANGE[0], FRAC_BITS_RANGE[1] + 1))
    @pytest.mark.parametrize("activation", ACTIVATION_NAMES)
    def test_is_the_smallest_and_largest_value_of_the_table(self, activation: str, frac_bits: int) -> None:
        values = table(activation, frac_bits)
        rng = random.Random(f"{activation} {frac_bits}")
        one = 1 << frac_bits
        marks = (0, 1, -1, one, -one, one + 1, -one - 1, SIGNAL_MAX, -SIGNAL_MAX)
        pairs = [*itertools.combinations_with_replacement(sorted(marks), 2)]
        pairs += [sorted(rng.choices(range(-SIGNAL_MAX, SIGNAL_MAX + 1), k=2)) for _ in range(50)]
        pairs += [sorted(rng.choices(range(-3 * one, 3 * one + 1), k=2)) for _ in range(50) if frac_bits < 12]
        for low, high in pairs:
            part = values[low + SIGNAL_MAX : high + SIGNAL_MAX + 1]
            assert image(activation, Interval(low, high), frac_bits) == (part.min(), part.max()), (low, high)

    @pytest.mark.parametrize("frac_bits", range(FRAC_BITS_RANGE[0], FRAC_BITS_RANGE[1] + 1))
    def test_of_every_single_argument_is_the_activation(self, frac_bits: int) -> None:
        for activation in ACTIVATION_NAMES:
            for u in range(-SIGNAL_MAX, SIGNAL_MAX + 1, 97):
                value = table(activation, frac_bits)[u + SIGNAL_MAX]
                assert image(activation, Interval(u, u), frac_bits) == (value, value)


class TestExactOnSimpleCases:
    def test_inputs_have_their_limits(self) -> None:
        controller = Controller((Input(limit=5), Input()), (), (Signal(0),))
        assert intervals(controller).signals == ((-5, 5), (-32767, 32767))

    def test_a_sum_is_exact_over_independent_inputs(self) -> None:
        node = Node((Link(0, sign=-1), Link(1, shift=2)), bias=7, activation="identity")
        bounds = intervals(single(node, 10, 100)).nodes[0]
        assert bounds.accumulator == (7 - 10 - 400, 7 + 10 + 400)

    def test_links_from_one_source_count_as_one_weight(self) -> None:
        node = Node((Link(0, shift=2), Link(0, sign=-1)), activation="identity")
        assert intervals(single(node, 10)).nodes[0].accumulator == (-30, 30)

    def test_links_with_different_delays_do_not(self) -> None:
        node = Node((Link(0), Link(0, delay=1, sign=-1)), activation="identity")
        assert intervals(single(node, 10)).nodes[0].accumulator == (-20, 20)

    def test_a_gain_is_applied_to_both_ends_rounding_down(self) -> None:
        node = Node((Link(0),), bias=1, gain=-2, activation="identity")
        bounds = intervals(single(node, 10)).nodes[0]
        assert bounds.accumulator == (-9, 11)
        assert bounds.scaled == (-3, 2)

    def test_the_argument_is_clipped_where_the_sum_is_not(self) -> None:
        node = Node((Link(0),), gain=3, activation="identity")
        bounds = intervals(single(node, 32767)).nodes[0]
        assert bounds.scaled == (-8 * 32767, 8 * 32767)
        assert bounds.argument == (-32767, 32767)

    def test_a_node_without_links_is_one_value(self) -> None:
        controller = single(Node((), bias=300, activation="clamped"), 1)
        assert intervals(controller).signals[1] == (256, 256)

    @pytest.mark.parametrize("activation", ACTIVATION_NAMES)
    def test_every_bound_of_one_node_is_reached(self, activation: str) -> None:
        node = Node((Link(0), Link(1, sign=-1)), bias=-9, gain=1, activation=activation)
        controller = single(node, 40, 30, frac_bits=6)
        reference = Reference(controller)
        values = [reference.step((x, y))[0] for x in range(-40, 41) for y in range(-30, 31)]
        # A gain of 1 skips every other argument, so only sums reach their bounds for certain; their image may be wider.
        even = [table(activation, 6)[2 * a + SIGNAL_MAX] for a in range(-79, 62)]
        assert (min(values), max(values)) == (min(even), max(even))
        bounds = intervals(controller)
        assert bounds.nodes[0].scaled == (-158, 122)
        assert bounds.signals[2] == image(activation, Interval(-158, 122), 6)


class TestDelayedLinks:
    def test_a_delayed_read_includes_the_zero_after_reset(self) -> None:
        constant = Node((), bias=100, activation="identity")
        delayed = Node((Link(1, delay=1),), activation="identity")
        controller = Controller((Input(),), (constant, delayed), (Signal(2),))
        assert intervals(controller).signals[1:] == ((100, 100), (0, 100))

    def test_a_loop_with_no_way_in_stays_at_zero(self) -> None:
        controller = single(Node((Link(1, delay=1),), activation="identity"), 1)
        assert intervals(controller).signals[1] == (0, 0)

    def test_a_leaking_loop_is_bounded_by_what_flows_in(self) -> None:
        # y = floor((y' + x) / 2) with |x| <= 100: rounding down keeps it from -100 to 99.
        controller = single(Node((Link(0), Link(1, delay=1)), gain=-1, activation="identity"), 100)
        assert intervals(controller).signals[1] == (-100, 99)

    def test_an_integrator_takes_the_whole_range(self) -> None:
        controller = single(Node((Link(0), Link(1, delay=1)), activation="identity"), 1)
        assert intervals(controller).signals[1] == (-32767, 32767)

    def test_a_counter_that_only_climbs_keeps_its_lower_bound(self) -> None:
        controller = single(Node((Link(1, delay=1),), bias=1, activation="identity"), 1)
        assert intervals(controller).signals[1] == (1, 32767)

    def test_one_that_only_falls_keeps_its_upper_bound(self) -> None:
        controller = single(Node((Link(1, delay=1),), bias=-1, activation="identity"), 1)
        assert intervals(controller).signals[1] == (-32767, -1)

    def test_widening_is_taken_back_behind_the_loop(self) -> None:
        # The integrator saturates at One; what reads it is bounded by One again, not by 32767.
        integrator = Node((Link(0), Link(1, delay=1)), activation="clamped")
        reader = Node((Link(1, delay=1), Link(1)), activation="identity")
        controller = Controller((Input(limit=1),), (integrator, reader), (Signal(2),))
        assert intervals(controller).signals[1:] == ((-256, 256), (-512, 512))

    def test_a_long_chain_of_loops_ends(self) -> None:
        nodes = tuple(
            Node((Link(i), Link(i + 1, delay=1), Link((i + 7) % 40, delay=1, shift=3)), activation="identity")
            for i in range(39)
        )
        controller = Controller((Input(limit=1),), nodes, (Signal(39),))
        assert intervals(controller).signals[39] == (-32767, 32767)


class TestSoundness:
    @patient
    @given(controllers_with_inputs(max_steps=12))
    def test_every_value_of_every_step_is_inside(self, case: tuple[Controller, list[list[int]]]) -> None:
        assert_sound(*case)

    @pytest.mark.parametrize("block", range(10))
    def test_every_value_of_seeded_controllers_is_inside(self, block: int, budget: int) -> None:
        for seed in range(block, 200 * budget, 10):
            rng = random.Random(seed)
            controller = random_controller(rng, size=rng.choice(("small", "medium")))
            assert_sound(controller, input_vectors(controller, rng, 60))

    @patient
    @given(st.integers(1, 50), st.integers(-7, 0), st.booleans())
    def test_a_single_loop_reaches_its_bounds(self, limit: int, gain: int, positive: bool) -> None:
        node = Node((Link(0), Link(1, delay=1, sign=1 if positive else -1)), gain=gain, activation="clamped")
        controller = single(node, limit, frac_bits=4)
        reference = Reference(controller)
        # Bang-bang inputs drive a sum to its extremes: always push the state on in the direction that it has.
        seen = set()
        for start in (limit, -limit):
            reference.reset()
            x = start
            for _ in range(200):
                seen.add(reference.step([x])[0])
                x = x if positive else -x
        low, high = intervals(controller).signals[1]
        assert low <= min(seen)
        assert max(seen) <= high
        if positive:
            assert (low, high) == (min(seen), max(seen))
