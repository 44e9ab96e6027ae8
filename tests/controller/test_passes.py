# SPDX-License-Identifier: MIT
"""Every pass keeps every output bit; each class also shows its pass at work, and where it must hold back."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given

from bitneat.controller import Constant, Controller, Input, Link, Node, Output, Reference, Signal
from bitneat.controller.ir import ACCUMULATOR_MAX
from bitneat.controller.passes import (
    PASSES,
    Pass,
    compose_gains,
    drop_needless_saturation,
    fold_constants,
    forward_copies,
    inline_sums,
    merge_duplicates,
    optimize,
    order_depth_first,
)
from tests.strategies import controllers_with_inputs, input_vectors, patient, random_controller

PREVIOUS = 1
"""The delay of a delayed link."""


def build(
    nodes: list[Node], *outputs: int | Output, limits: tuple[int, ...] = (100, 100), frac_bits: int = 8
) -> Controller:
    inputs = tuple(Input(limit=limit) for limit in limits)
    named = tuple(Signal(output) if isinstance(output, int) else output for output in outputs)
    return Controller(inputs, tuple(nodes), named, frac_bits)


def sums(*links: Link, bias: int = 0, gain: int = 0) -> Node:
    return Node(links, bias, gain, "identity")


def squash(*links: Link, bias: int = 0, gain: int = 0) -> Node:
    """A node that no pass can take for anything else."""
    return Node(links, bias, gain, "tanh")


def assert_equivalent(original: Controller, rewritten: Controller, sequence: list[list[int]]) -> None:
    expected = Reference(original).run(sequence)
    assert Reference(rewritten).run(sequence) == expected, f"{original} became {rewritten}"


def assert_rewrites(rewrite: Pass, original: Controller, expected: Controller) -> None:
    """The pass gives just this, and it is the same controller on many sequences."""
    result = rewrite(original)
    assert result == expected
    rng = random.Random(1)
    for _ in range(20):
        assert_equivalent(original, result, input_vectors(original, rng, 30))
        vectors = input_vectors(original, rng, 30)
        rng.shuffle(vectors)
        assert_equivalent(original, result, vectors)


def assert_leaves_alone(rewrite: Pass, controller: Controller) -> None:
    assert controller == controller.canonical, "the case itself is not canonical"
    assert rewrite(controller) == controller


class TestFoldConstants:
    def test_a_node_with_one_value_becomes_a_bias_of_its_readers(self) -> None:
        # |u| <= 300 < One: the hat of 600 and more is 0, and the step of 600 - 300 and more is One.
        original = build([Node((Link(0),), 600, 0, "step"), squash(Link(1), Link(2, sign=-1))], 3, limits=(300, 300))
        assert_rewrites(fold_constants, original, build([squash(Link(1), bias=-256)], 3 - 1, limits=(300, 300)))

    def test_an_output_becomes_a_constant(self) -> None:
        original = build([Node((Link(0),), 600, 0, "step")], 2, limits=(300, 300))
        assert_rewrites(fold_constants, original, build([], Constant(256), limits=(300, 300)))

    def test_a_delayed_reader_still_sees_the_zero_of_the_first_step(self) -> None:
        original = build([Node((Link(0),), 600, 0, "step"), squash(Link(2, PREVIOUS))], 3)
        expected = build([Node((), 256, 0, "clamped"), squash(Link(2, PREVIOUS))], 3)
        assert_rewrites(fold_constants, original, expected)

    def test_a_value_beyond_one_stays_an_identity(self) -> None:
        original = build([Node((Link(0),), 40000, 0, "identity"), squash(Link(2, PREVIOUS))], 3)
        expected = build([Node((), 32767, 0, "identity"), squash(Link(2, PREVIOUS))], 3)
        assert_rewrites(fold_constants, original, expected)

    def test_links_that_read_nothing_but_zero_go(self) -> None:
        zero = Node((Link(0),), 600, 0, "hat")
        original = build([zero, squash(Link(2, PREVIOUS), Link(2), Link(1))], 3)
        assert_rewrites(fold_constants, original, build([squash(Link(1))], 2))

    def test_a_loop_with_no_way_in_is_zero(self) -> None:
        original = build([sums(Link(3, PREVIOUS)), sums(Link(2))], 3)
        assert_rewrites(fold_constants, original, build([], Constant(0)))

    def test_a_value_that_is_zero_at_the_first_step_only_is_left_alone(self) -> None:
        assert_leaves_alone(
            fold_constants,
            build([Node((), 256, 0, "clamped"), sums(Link(2, PREVIOUS)), squash(Link(3))], 4),
        )

    def test_a_ternary_controller_stays_ternary(self) -> None:
        # At F = 4, sigmoid(5 * 15 / 16) to sigmoid(5 * 17 / 16) are all 15 / 16, which is no ternary bias.
        node = Node((Link(0),), 16, 0, "sigmoid")
        case = build([node, squash(Link(1), Link(2))], 3, limits=(1, 100), frac_bits=4)
        assert case.is_ternary
        assert_leaves_alone(fold_constants, case)
        one = build([Node((Link(0),), 256, 0, "step"), sums(Link(1), Link(2), bias=256)], 3)
        assert one.is_ternary
        assert_leaves_alone(fold_constants, one)  # else the reader's bias would be 2
        alone = build([node], 2, limits=(1, 100), frac_bits=4)
        assert_rewrites(fold_constants, alone, build([], Constant(15), limits=(1, 100), frac_bits=4))


class TestDropNeedlessSaturation:
    def test_a_clamp_that_never_acts_becomes_the_identity(self) -> None:
        original = build([Node((Link(0), Link(1)), 0, 0, "clamped")], 2, limits=(128, 128))
        expected = build([sums(Link(0), Link(1))], 2, limits=(128, 128))
        assert_rewrites(drop_needless_saturation, original, expected)

    def test_a_clamp_that_can_act_by_one_stays(self) -> None:
        assert_leaves_alone(
            drop_needless_saturation, build([Node((Link(0), Link(1)), 0, 0, "clamped")], 2, limits=(128, 129))
        )

    @pytest.mark.parametrize("activation", ["relu", "abs"])
    def test_a_rectifier_of_what_is_never_negative_becomes_the_identity(self, activation: str) -> None:
        original = build([Node((Link(0),), 100, 0, activation)], 2)
        assert_rewrites(drop_needless_saturation, original, build([sums(Link(0), bias=100)], 2))

    def test_an_absolute_value_of_what_is_never_positive_becomes_the_negated_sum(self) -> None:
        original = build([Node((Link(0), Link(1, PREVIOUS, 0, -1)), -200, 2, "abs")], 2)
        expected = build([sums(Link(0, sign=-1), Link(1, PREVIOUS), bias=200, gain=2)], 2)
        assert_rewrites(drop_needless_saturation, original, expected)

    def test_a_negated_floor_is_no_floor_of_the_negated_sum(self) -> None:
        assert_leaves_alone(drop_needless_saturation, build([Node((Link(0),), -100, -1, "abs")], 2))

    def test_a_clamp_in_a_loop_goes_if_the_loop_leaks_enough(self) -> None:
        original = build([Node((Link(0), Link(2, PREVIOUS)), 0, -1, "clamped")], 2)
        expected = build([Node((Link(0), Link(2, PREVIOUS)), 0, -1, "identity")], 2)
        assert_rewrites(drop_needless_saturation, original, expected)

    def test_a_clamp_stays_if_its_reader_could_then_leave_the_accumulator(self) -> None:
        # As an identity the clamp would count as 32767 instead of 256. Its reader has room for that or not.
        clamp = Node((Link(0), Link(0, shift=1)), 0, 0, "clamped")
        links = [*(Link(2, delay, shift) for delay in (0, 1) for shift in range(8)), Link(1), Link(1, shift=1)]
        total = (510 + 3) * 32767
        assert total << 6 <= ACCUMULATOR_MAX < total << 7
        fits = build([clamp, squash(*sorted(links), gain=6)], 3, limits=(50, 32767))
        expected = build([sums(*clamp.links), fits.nodes[1]], 3, limits=(50, 32767))
        assert_rewrites(drop_needless_saturation, fits, expected)
        does_not_fit = build([clamp, squash(*sorted(links), gain=7)], 3, limits=(50, 32767))
        assert_leaves_alone(drop_needless_saturation, does_not_fit)


class TestForwardCopies:
    def test_readers_and_outputs_of_a_copy_use_its_source(self) -> None:
        original = build([sums(Link(0)), squash(Link(2, sign=-1), Link(1))], 2, 3)
        assert_rewrites(forward_copies, original, build([squash(Link(0, sign=-1), Link(1))], 0, 2))

    def test_a_delayed_reader_of_a_copy_reads_its_source_delayed(self) -> None:
        original = build([sums(Link(0)), squash(Link(2, PREVIOUS))], 3)
        assert_rewrites(forward_copies, original, build([squash(Link(0, PREVIOUS))], 2))

    def test_a_reader_of_a_delaying_copy_reads_its_source_delayed(self) -> None:
        original = build([sums(Link(0, PREVIOUS)), squash(Link(2))], 3)
        assert_rewrites(forward_copies, original, build([squash(Link(0, PREVIOUS))], 2))

    def test_a_delay_of_two_steps_needs_its_node(self) -> None:
        assert_leaves_alone(forward_copies, build([sums(Link(0, PREVIOUS)), squash(Link(2, PREVIOUS))], 3))

    def test_an_output_cannot_name_a_delayed_negated_or_shifted_signal(self) -> None:
        nodes = [sums(Link(0, PREVIOUS)), sums(Link(0, sign=-1)), sums(Link(0, shift=1)), sums(Link(0), gain=1)]
        assert_leaves_alone(forward_copies, build(nodes, 2, 3, 4, 5))

    def test_a_negated_copy_flips_the_sign_of_its_readers(self) -> None:
        original = build([sums(Link(0, sign=-1)), squash(Link(2), Link(1)), squash(Link(2, sign=-1))], 3, 4)
        expected = build([squash(Link(0, sign=-1), Link(1)), squash(Link(0))], 2, 3)
        assert_rewrites(forward_copies, original, expected)

    def test_shifts_add_up(self) -> None:
        original = build([sums(Link(0, shift=2), gain=1), squash(Link(2, shift=4))], 3)
        assert_rewrites(forward_copies, original, build([squash(Link(0, shift=7))], 2))

    def test_a_shift_that_the_gain_takes_back_is_a_copy(self) -> None:
        original = build([sums(Link(0, shift=2), gain=-2), squash(Link(2))], 2, 3)
        assert_rewrites(forward_copies, original, build([squash(Link(0))], 0, 2))

    def test_shifts_beyond_seven_do_not_fit_a_link(self) -> None:
        assert_leaves_alone(forward_copies, build([sums(Link(0, shift=4)), squash(Link(2, shift=4))], 3))

    def test_a_copy_that_rounds_down_is_no_copy(self) -> None:
        assert_leaves_alone(forward_copies, build([sums(Link(0), gain=-1), squash(Link(2))], 3))

    def test_a_copy_that_can_clip_is_no_copy(self) -> None:
        assert_leaves_alone(forward_copies, build([sums(Link(0, shift=1)), squash(Link(2))], 3, limits=(20000, 100)))

    def test_a_saturation_that_the_limits_rule_out_is_no_obstacle(self) -> None:
        original = build([Node((Link(0),), 0, 0, "clamped"), squash(Link(2))], 3, limits=(256,) * 2)
        assert_rewrites(forward_copies, original, build([squash(Link(0))], 2, limits=(256,) * 2))

    def test_one_that_they_do_not_is(self) -> None:
        assert_leaves_alone(
            forward_copies, build([Node((Link(0),), 0, 0, "clamped"), squash(Link(2))], 3, limits=(257,) * 2)
        )

    def test_a_link_that_meets_its_negation_cancels(self) -> None:
        original = build([sums(Link(0)), squash(Link(0, sign=-1), Link(1), Link(2))], 3)
        assert_rewrites(forward_copies, original, build([squash(Link(1))], 2))

    def test_a_link_that_meets_its_equal_stays(self) -> None:
        assert_leaves_alone(forward_copies, build([sums(Link(0)), squash(Link(0), Link(2))], 3))

    def test_a_copy_of_itself_ends(self) -> None:
        case = build([sums(Link(3, PREVIOUS)), sums(Link(2)), squash(Link(0), Link(3))], 4)
        result = forward_copies(case)
        assert_equivalent(case, result, [[5, 0], [7, 0]])

    def test_a_ternary_controller_gets_no_shifts(self) -> None:
        assert_leaves_alone(forward_copies, build([sums(Link(0), gain=3), squash(Link(1), Link(2))], 3))

    def test_chains_go_in_one_pass(self) -> None:
        chain = [sums(Link(0)), *(sums(Link(i, sign=-1)) for i in range(2, 6))]
        original = build([*chain, squash(Link(6), Link(1))], 7)
        assert_rewrites(forward_copies, original, build([squash(Link(0), Link(1))], 2))


class TestInlineSums:
    def test_a_sum_with_one_reader_moves_into_it(self) -> None:
        original = build([sums(Link(0), Link(1, sign=-1), bias=7), squash(Link(1, PREVIOUS), Link(2, sign=-1))], 3)
        expected = build([squash(Link(0, sign=-1), Link(1), Link(1, PREVIOUS), bias=-7)], 2)
        assert_rewrites(inline_sums, original, expected)

    def test_shift_and_gain_are_carried_along(self) -> None:
        original = build([sums(Link(0, shift=1), Link(1), bias=3, gain=2), squash(Link(1), Link(2, shift=1))], 3)
        expected = build([squash(Link(0, shift=4), Link(1), Link(1, shift=3), bias=24)], 2)
        assert_rewrites(inline_sums, original, expected)

    def test_a_delayed_reader_takes_the_links_delayed(self) -> None:
        original = build([sums(Link(0), Link(1)), squash(Link(0), Link(2, PREVIOUS))], 3)
        expected = build([squash(Link(0), Link(0, PREVIOUS), Link(1, PREVIOUS))], 2)
        assert_rewrites(inline_sums, original, expected)

    def test_a_delayed_reader_cannot_take_a_bias(self) -> None:
        assert_leaves_alone(inline_sums, build([sums(Link(0), bias=1), squash(Link(0), Link(2, PREVIOUS))], 3))

    def test_links_cancel(self) -> None:
        original = build([sums(Link(0), Link(1)), squash(Link(0, sign=-1), Link(2))], 3)
        assert_rewrites(inline_sums, original, build([squash(Link(1))], 2))

    def test_a_link_that_meets_its_equal_stays(self) -> None:
        assert_leaves_alone(inline_sums, build([sums(Link(0), Link(1)), squash(Link(0), Link(2))], 3))

    def test_a_sum_that_is_also_an_output_stays(self) -> None:
        assert_leaves_alone(inline_sums, build([sums(Link(0), Link(1)), squash(Link(0, PREVIOUS), Link(2))], 2, 3))

    def test_a_sum_that_several_read_stays(self) -> None:
        assert_leaves_alone(
            inline_sums, build([sums(Link(0), Link(1)), squash(Link(2)), squash(Link(0, PREVIOUS), Link(2))], 3, 4)
        )

    def test_a_sum_that_can_clip_stays(self) -> None:
        assert_leaves_alone(inline_sums, build([sums(Link(0), Link(1)), squash(Link(2))], 3, limits=(20000, 20000)))

    def test_a_sum_that_rounds_down_stays(self) -> None:
        assert_leaves_alone(inline_sums, build([sums(Link(0), Link(1), gain=-1), squash(Link(2))], 3))

    def test_a_ternary_controller_gets_no_shifts_and_no_bias_of_two(self) -> None:
        assert_leaves_alone(inline_sums, build([sums(Link(0), Link(1), gain=1), squash(Link(0), Link(2))], 3))
        assert_leaves_alone(inline_sums, build([sums(Link(0), Link(1), bias=256), squash(Link(2), bias=256)], 3))

    def test_a_chain_of_sums_becomes_one(self) -> None:
        original = build([sums(Link(0), Link(1)), sums(Link(2), bias=3), squash(Link(3), Link(0, PREVIOUS))], 4)
        expected = build([squash(Link(0), Link(0, PREVIOUS), Link(1), bias=3)], 2)
        assert_rewrites(inline_sums, original, expected)


class TestComposeGains:
    def test_gains_add_up(self) -> None:
        original = build([sums(Link(0), Link(1), bias=5, gain=2), squash(Link(2), gain=1)], 3)
        assert_rewrites(compose_gains, original, build([squash(Link(0), Link(1), bias=5, gain=3)], 2))

    def test_two_floors_are_one(self) -> None:
        original = build([sums(Link(0), Link(1), bias=5, gain=-2), squash(Link(2), gain=-3)], 3)
        assert_rewrites(compose_gains, original, build([squash(Link(0), Link(1), bias=5, gain=-5)], 2))

    def test_up_then_down_is_exact(self) -> None:
        original = build([sums(Link(0), Link(1), gain=2), squash(Link(2, sign=-1), gain=-5)], 3)
        expected = build([squash(Link(0, sign=-1), Link(1, sign=-1), gain=-3)], 2)
        assert_rewrites(compose_gains, original, expected)

    def test_down_then_up_is_not(self) -> None:
        assert_leaves_alone(compose_gains, build([sums(Link(0), Link(1), gain=-2), squash(Link(2), gain=1)], 3))

    def test_a_floor_that_is_negated_is_not(self) -> None:
        assert_leaves_alone(
            compose_gains, build([sums(Link(0), Link(1), gain=-2), squash(Link(2, sign=-1), gain=-1)], 3)
        )

    def test_a_shift_counts_as_gain(self) -> None:
        original = build([sums(Link(0), Link(1), gain=-2), squash(Link(2, shift=3), gain=-4)], 3)
        assert_rewrites(compose_gains, original, build([squash(Link(0), Link(1), gain=-3)], 2))

    def test_a_delayed_reader_takes_the_links_delayed(self) -> None:
        original = build([sums(Link(0), Link(1), gain=-2), squash(Link(2, PREVIOUS), gain=-1)], 3)
        expected = build([squash(Link(0, PREVIOUS), Link(1, PREVIOUS), gain=-3)], 2)
        assert_rewrites(compose_gains, original, expected)

    def test_a_delayed_reader_cannot_take_a_bias(self) -> None:
        assert_leaves_alone(compose_gains, build([sums(Link(0), bias=8, gain=1), squash(Link(2, PREVIOUS), gain=1)], 3))

    def test_gains_beyond_seven_do_not_fit(self) -> None:
        assert_leaves_alone(compose_gains, build([sums(Link(0), gain=4), squash(Link(2), gain=4)], 3, limits=(1, 1)))

    def test_a_reader_with_a_bias_or_another_link_is_left_alone(self) -> None:
        assert_leaves_alone(compose_gains, build([sums(Link(0), gain=1), squash(Link(2), bias=1)], 3))
        assert_leaves_alone(compose_gains, build([sums(Link(0), gain=1), squash(Link(1), Link(2))], 3))

    def test_a_sum_that_would_leave_the_accumulator_is_left_alone(self) -> None:
        # Each sum is within the rule, but 2 * 32767 * 2^14 counts against the composed one, whatever its limits are.
        inner = sums(Link(2), Link(3), gain=7)
        low = [Node((Link(i),), -1, -7, "relu") for i in range(2)]
        case = build([*low, inner, squash(Link(4), gain=7)], 5, limits=(200, 200))
        assert_leaves_alone(compose_gains, case)


class TestMergeDuplicates:
    def test_equal_nodes_become_one(self) -> None:
        twins = [squash(Link(0), Link(1)), squash(Link(1), Link(0))]
        original = build([*twins, squash(Link(2), Link(3, PREVIOUS))], 3, 4)
        expected = build([squash(Link(0), Link(1)), squash(Link(2), Link(2, PREVIOUS))], 2, 3)
        assert_rewrites(merge_duplicates, original, expected)

    def test_nodes_over_equal_nodes_are_equal(self) -> None:
        original = build([squash(Link(0)), squash(Link(0)), squash(Link(2)), squash(Link(3))], 4, 5)
        assert_rewrites(merge_duplicates, original, build([squash(Link(0)), squash(Link(2))], 3, 3))

    def test_equal_loops_are_equal(self) -> None:
        loops = [squash(Link(0), Link(2, PREVIOUS)), squash(Link(0), Link(3, PREVIOUS))]
        original = build(loops, 2, 3)
        assert_rewrites(merge_duplicates, original, build(loops[:1], 2, 2))

    def test_loops_through_each_other_are_equal_too(self) -> None:
        original = build([squash(Link(0), Link(3, PREVIOUS)), squash(Link(0), Link(2, PREVIOUS))], 2, 3)
        assert_rewrites(merge_duplicates, original, build([squash(Link(0), Link(2, PREVIOUS))], 2, 2))

    @pytest.mark.parametrize(
        "other",
        [
            squash(Link(0, sign=-1)),
            squash(Link(0, PREVIOUS)),
            squash(Link(0, shift=1)),
            squash(Link(1)),
            squash(Link(0), bias=1),
            squash(Link(0), gain=1),
            Node((Link(0),), 0, 0, "sin"),
        ],
    )
    def test_nodes_that_differ_in_one_thing_stay(self, other: Node) -> None:
        assert_leaves_alone(merge_duplicates, build([squash(Link(0)), other], 2, 3))

    def test_links_to_equal_nodes_cancel_if_opposite(self) -> None:
        twins = [squash(Link(0)), squash(Link(0))]
        original = build([*twins, squash(Link(1), Link(2), Link(3, sign=-1))], 4)
        assert_rewrites(merge_duplicates, original, build([squash(Link(1))], 2))

    def test_links_to_equal_nodes_stay_if_alike(self) -> None:
        """Two nodes and two links of weight 1 are how a ternary network says 2."""
        assert_leaves_alone(merge_duplicates, build([squash(Link(0)), squash(Link(0)), squash(Link(2), Link(3))], 4))


class TestOptimize:
    def test_passes_feed_each_other(self) -> None:
        # The clamp is needless, so its node is a copy, so the two hats are the same.
        nodes = [
            Node((Link(0),), 0, 0, "clamped"),
            Node((Link(2),), 0, 0, "hat"),
            Node((Link(0),), 0, 0, "hat"),
            squash(Link(3), Link(4, sign=-1), Link(1)),
        ]
        original = build(nodes, 5)
        assert_rewrites(optimize, original, build([squash(Link(1))], 2))

    def test_the_hash_of_the_original_is_not_that_of_the_optimized(self) -> None:
        original = build([sums(Link(0)), squash(Link(2))], 3)
        assert optimize(original).sha256 != original.sha256

    def test_a_controller_without_nodes_stays(self) -> None:
        assert_leaves_alone(optimize, build([], 1, Constant(5)))


def test_nodes_are_ordered_depth_first_from_the_outputs() -> None:
    original = build(
        [sums(Link(0)), sums(Link(1)), sums(Link(0), Link(1)), squash(Link(2), Link(4)), squash(Link(3))], 6, 5
    )
    expected = build(
        [sums(Link(1)), squash(Link(2)), sums(Link(0)), sums(Link(0), Link(1)), squash(Link(4), Link(5))], 3, 6
    )
    assert_rewrites(order_depth_first, original, expected)


@pytest.mark.parametrize("rewrite", [*PASSES, optimize, order_depth_first], ids=lambda rewrite: rewrite.__name__)
class TestEveryPass:
    @patient
    @given(case=controllers_with_inputs(max_steps=10, max_nodes=6))
    def test_keeps_every_output_bit(self, rewrite: Pass, case: tuple[Controller, list[list[int]]]) -> None:
        controller, sequence = case
        result = rewrite(controller)
        assert_equivalent(controller, result, sequence)
        assert result.canonical == result
        assert result.inputs == controller.inputs
        assert result.is_ternary or not controller.canonical.is_ternary


@pytest.mark.parametrize("block", range(20))
def test_seeded_controllers_keep_every_output_bit(block: int, budget: int) -> None:
    for seed in range(block, 2100 * budget, 20):
        rng = random.Random(seed)
        controller = random_controller(rng, size=rng.choices(("small", "medium", "large"), (20, 5, 1))[0])
        sequence = input_vectors(controller, rng, 16)
        expected = Reference(controller).run(sequence)
        canonical = controller.canonical
        optimized = optimize(canonical)
        for result in {canonical, PASSES[seed % len(PASSES)](canonical), optimized} - {controller}:
            assert Reference(result).run(sequence) == expected, f"seed {seed} became {result}"
        assert optimize(optimized) == optimized, f"seed {seed}"


def test_every_pass_finds_work_in_seeded_controllers() -> None:
    idle = set(PASSES)
    for seed in itertools.count():
        if not idle:
            break
        assert seed < 2000, f"no work found for {sorted(rewrite.__name__ for rewrite in idle)}"
        controller = random_controller(random.Random(seed), size="small")
        idle -= {rewrite for rewrite in idle if rewrite(controller) != controller.canonical}
