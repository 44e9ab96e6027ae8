# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import math
import warnings
from fractions import Fraction
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bitneat.controller import BoxAction, Constant, Controller, DiscreteAction, Encoder, Input, action_from_data
from bitneat.errors import BitneatError
from tests.strategies import patient


def encoder(*inputs: Input, frac_bits: int = 8) -> Encoder:
    return Encoder(Controller(inputs, (), (Constant(0),), frac_bits))


def exactly_encoded(observation: float, scale: int, limit: int, frac_bits: int) -> int:
    """The encode formula in exact rational numbers."""
    if math.isinf(observation):
        return limit if observation > 0 else -limit
    exact = Fraction(observation) * Fraction(2) ** (frac_bits + scale)
    return max(-limit, min(limit, round(exact)))  # round of a Fraction takes ties to even


class TestEncoder:
    @pytest.mark.parametrize(
        ("halves", "signal"), [(1, 0), (3, 2), (5, 2), (7, 4), (-1, 0), (-3, -2), (-5, -2), (-7, -4), (2, 1), (-2, -1)]
    )
    def test_ties_go_to_even(self, halves: int, signal: int) -> None:
        assert encoder(Input())([halves / 512]) == [signal]

    def test_the_scale_is_a_power_of_two(self) -> None:
        assert encoder(Input(), Input(3), Input(-8), Input(-9))([1.0, 1.0, 1.0, 1.0]).tolist() == [256, 2048, 1, 0]

    def test_values_beyond_the_limit_are_clipped(self) -> None:
        encode = encoder(Input(), Input(limit=100))
        assert encode([1000.0, 1000.0]).tolist() == [32767, 100]
        assert encode([-1000.0, -1000.0]).tolist() == [-32767, -100]
        assert encode([32767 / 256, 100.4 / 256]).tolist() == [32767, 100]

    def test_infinities_go_to_the_limits(self) -> None:
        encode = encoder(Input(), Input(-16, 7))
        assert encode([math.inf, -math.inf]).tolist() == [32767, -7]

    def test_what_overflows_goes_to_the_limit_without_a_warning(self) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert encoder(Input(15), Input(15))([1.7e308, -1.7e308]).tolist() == [32767, -32767]

    def test_nan_is_an_error_that_names_the_component(self) -> None:
        with pytest.raises(BitneatError, match=r"^observation\[2\]: is NaN, expected a number$"):
            encoder(Input(), Input(), Input())([0.0, 0.0, math.nan])

    @pytest.mark.parametrize("observation", ["high", [None, {}], [[1.0], [2.0, 3.0]]])
    def test_what_is_no_array_of_numbers_is_refused(self, observation: Any) -> None:
        with pytest.raises(BitneatError, match=r"^observation: expected an array of numbers$"):
            encoder(Input(), Input())(observation)

    @pytest.mark.parametrize("observation", [[], [1.0], [1.0, 2.0, 3.0], 1.0, [[1.0], [2.0]]])
    def test_the_number_of_components_must_fit(self, observation: Any) -> None:
        with pytest.raises(BitneatError, match=r"^observation: expected 2 components, got an array of shape \("):
            encoder(Input(), Input())(observation)

    @pytest.mark.parametrize(
        "dtype", ["int8", "uint8", "int16", "int32", "int64", "float16", "float32", "float64", "bool"]
    )
    def test_observations_may_be_of_any_number_type(self, dtype: str) -> None:
        result = encoder(Input(-2), Input(-2))(np.array([1, 0], dtype))
        assert result.dtype == np.int16
        assert result.tolist() == [64, 0]

    def test_large_integers_are_clipped(self) -> None:
        encode = encoder(Input(), Input())
        assert encode(np.array([2**62, -(2**62)])).tolist() == [32767, -32767]

    def test_float32_observations_are_widened_before_they_are_scaled(self) -> None:
        value = np.float32(0.1)
        assert encoder(Input(15))(np.array([value])) == [min(32767, round(float(value) * 2**23))]

    def test_rows_of_observations_are_encoded_one_by_one(self) -> None:
        rows = np.linspace(-2, 2, 12).reshape(3, 2, 2)
        encode = encoder(Input(), Input(limit=300))
        result = encode(rows)
        assert result.shape == rows.shape
        for row, expected in zip(rows.reshape(-1, 2), result.reshape(-1, 2), strict=True):
            assert encode(row).tolist() == expected.tolist()

    @patient
    @given(
        st.floats(allow_nan=False),
        st.integers(-16, 15),
        st.integers(1, 32767),
        st.integers(4, 12),
    )
    def test_follows_the_formula_exactly(self, observation: float, scale: int, limit: int, frac_bits: int) -> None:
        result = encoder(Input(scale, limit), frac_bits=frac_bits)([observation])
        assert result == [exactly_encoded(observation, scale, limit, frac_bits)]

    @patient
    @given(st.integers(-70000, 70000), st.integers(-8, 8), st.integers(4, 12), st.sampled_from([-1, 0, 1]))
    def test_follows_the_formula_around_ties(self, halves: int, scale: int, frac_bits: int, nudge: int) -> None:
        tie = halves * 2.0 ** -(frac_bits + scale + 1)
        observation = math.nextafter(tie, nudge * math.inf) if nudge else tie
        result = encoder(Input(scale), frac_bits=frac_bits)([observation])
        assert result == [exactly_encoded(observation, scale, 32767, frac_bits)]


def box(low: list[float], high: list[float], dtype: str = "float32", shape: tuple[int, ...] | None = None) -> BoxAction:
    return BoxAction(tuple(low), tuple(high), shape if shape is not None else (len(low),), dtype)


def signals(*values: int) -> np.ndarray[Any, np.dtype[np.int16]]:
    return np.array(values, np.int16)


class TestBoxAction:
    def test_maps_minus_one_and_one_to_the_bounds(self) -> None:
        action = box([-2.0, 0.0], [2.0, 10.0])
        assert action.decode(signals(-256, -256), 8).tolist() == [-2.0, 0.0]
        assert action.decode(signals(256, 256), 8).tolist() == [2.0, 10.0]
        assert action.decode(signals(0, 64), 8).tolist() == [0.0, 6.25]

    def test_signals_beyond_one_are_clipped(self) -> None:
        assert box([-2.0] * 2, [2.0] * 2).decode(signals(32767, -300), 8).tolist() == [2.0, -2.0]

    @pytest.mark.parametrize("frac_bits", [4, 8, 12])
    def test_one_is_two_to_the_frac_bits(self, frac_bits: int) -> None:
        action = box([-1.0], [1.0])
        assert action.decode(signals((1 << frac_bits) // 2), frac_bits) == [0.5]

    def test_computes_in_double_precision_and_rounds_once(self) -> None:
        low, high = float(np.float32(0.1)), float(np.float32(0.7))
        result = box([low], [high]).decode(signals(77), 8)
        assert result.dtype == np.float32
        assert result[0] == np.float32(low + (77 / 256 + 1.0) / 2.0 * (high - low))

    def test_has_the_shape_and_type_of_the_space(self) -> None:
        action = box([-1.0] * 6, [1.0] * 6, "float64", (2, 3))
        result = action.decode(signals(*range(6)), 8)
        assert result.shape == (2, 3)
        assert result.dtype == np.float64
        assert result[1, 2] == 5 / 256
        assert action.num_outputs == 6
        assert box([0.0], [1.0], shape=()).decode(signals(0), 8).shape == ()

    def test_an_integer_space_gets_integers_cut_toward_zero(self) -> None:
        result = box([-5.0] * 4, [5.0] * 4, "int32").decode(signals(-256, -77, 77, 256), 8)
        assert result.dtype == np.int32
        assert result.tolist() == [-5, -1, 1, 5]
        assert box([0.0], [255.0], "uint8").decode(signals(256), 8).tolist() == [255]

    @pytest.mark.parametrize("name", ["BipedalWalker-v3", "Pendulum-v1", "MountainCarContinuous-v0"])
    def test_every_action_is_in_the_space(self, name: str) -> None:
        space = gym.make(name).action_space
        assert isinstance(space, gym.spaces.Box)
        low, high = (tuple(float(v) for v in bound.ravel()) for bound in (space.low, space.high))
        action = BoxAction(low, high, space.shape, space.dtype.name)
        for value in (-32767, -257, -256, -255, -1, 0, 1, 255, 256, 257, 32767):
            assert space.contains(action.decode(signals(*[value] * action.num_outputs), 8)), value

    @pytest.mark.parametrize(
        ("low", "high"),
        [([-math.inf], [1.0]), ([0.0], [math.inf]), ([math.nan], [1.0]), ([2.0], [1.0]), ([-1e308], [1e308])],
    )
    def test_an_unbounded_space_is_refused(self, low: list[float], high: list[float]) -> None:
        with pytest.raises(
            BitneatError, match=r"^action space: expected a Box with finite bounds, low <= high, and a finite width$"
        ):
            box(low, high)

    @pytest.mark.parametrize(
        ("low", "high", "shape"),
        [([], [], (0,)), ([0.0], [1.0, 1.0], (1,)), ([0.0], [1.0], (2,)), ([0.0], [1.0], (1, 2))],
    )
    def test_bounds_that_do_not_agree_are_refused(self, low: list[float], high: list[float], shape: tuple[int]) -> None:
        with pytest.raises(BitneatError, match=r"^action space: low, high and shape of the Box do not agree$"):
            box(low, high, shape=shape)

    def test_an_axis_of_less_than_nothing_is_refused(self) -> None:
        with pytest.raises(BitneatError, match=r"^action space: the shape of the Box has an axis without components$"):
            box([0.0, 0.0], [1.0, 1.0], shape=(-1, -2))

    def test_a_type_that_is_no_number_is_refused(self) -> None:
        with pytest.raises(BitneatError, match=r"^action space: cannot decode to dtype 'bool'$"):
            box([0.0], [1.0], "bool")


class TestDiscreteAction:
    def test_is_the_index_of_the_largest_output(self) -> None:
        assert DiscreteAction(3).decode(signals(-5, 7, 6), 8) == 1

    def test_the_lowest_of_equals_wins(self) -> None:
        assert DiscreteAction(4).decode(signals(-5, 7, 7, 7), 8) == 1
        assert DiscreteAction(3).decode(signals(0, 0, 0), 8) == 0
        assert DiscreteAction(2).decode(signals(-32767, -32767), 8) == 0

    def test_counts_from_the_start_of_the_space(self) -> None:
        assert DiscreteAction(3, -1).decode(signals(0, 0, 1), 8) == 1
        assert DiscreteAction(3, 10).decode(signals(1, 0, 0), 8) == 10

    def test_needs_an_output_for_each_choice(self) -> None:
        assert DiscreteAction(5, 2).num_outputs == 5

    def test_is_a_plain_int(self) -> None:
        assert type(DiscreteAction(2).decode(signals(0, 1), 8)) is int

    @pytest.mark.parametrize(("n", "start"), [(0, 0), (-1, 0), (2.0, 0), (2, 0.0), (True, 0), (2, None)])
    def test_impossible_spaces_are_refused(self, n: Any, start: Any) -> None:
        with pytest.raises(BitneatError, match=r"^action space: expected a Discrete\(n >= 1\), got n="):
            DiscreteAction(n, start)


class TestPlainData:
    @pytest.mark.parametrize(
        "action",
        [
            box([-1.0, 0.1], [1.0, 7.3]),
            box([-1.0] * 6, [1.0] * 6, "int64", (2, 3)),
            box([0.0], [1.0], shape=()),
            DiscreteAction(4),
            DiscreteAction(3, -1),
        ],
    )
    def test_is_read_back_without_loss(self, action: BoxAction | DiscreteAction) -> None:
        assert action_from_data(json.loads(json.dumps(action.to_data()))) == action

    def test_whole_bounds_are_read_as_floats_and_axes_as_integers(self) -> None:
        data = {"kind": "box", "low": [-1], "high": [3], "shape": [1], "dtype": "float32"}
        action = action_from_data(data)
        assert isinstance(action, BoxAction)
        assert [type(value) for value in (*action.low, *action.high, *action.shape)] == [float, float, int]

    @pytest.mark.parametrize("data", [None, {}, [], {"kind": "tuple"}, {"kind": ["box"]}, {"kind": None}])
    def test_of_another_kind_is_refused(self, data: object) -> None:
        with pytest.raises(BitneatError, match=r"^action: expected a mapping whose 'kind' is 'box' or 'discrete'$"):
            action_from_data(data)

    @pytest.mark.parametrize("change", [{"extra": 1}, {"start": None}])
    def test_with_other_keys_is_refused(self, change: dict[str, object]) -> None:
        data = {"kind": "discrete", "n": 2, "start": 0} | change
        if change.get("start", 0) is None:
            del data["start"]
        with pytest.raises(BitneatError, match=r"^action: expected the keys kind, n, start, got "):
            action_from_data(data)

    @pytest.mark.parametrize(
        ("key", "value"),
        [
            ("low", None), ("low", ["x"]), ("low", ["1"]), ("low", [True]),
            ("low", [None]), ("high", 1.0), ("low", [10**400]),
            ("shape", ["a"]), ("dtype", "no such type"), ("dtype", 5), ("high", [math.inf]), ("dtype", "complex128"),
        ],
    )  # fmt: skip
    def test_with_impossible_values_is_refused_in_one_line(self, key: str, value: object) -> None:
        with pytest.raises(BitneatError, match=r"^action[^\n]*: [^\n]+$"):
            action_from_data(box([0.0], [1.0]).to_data() | {key: value})
