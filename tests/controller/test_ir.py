# SPDX-License-Identifier: MIT
from __future__ import annotations

import copy
import dataclasses
import json
import pickle
import random
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from bitneat.controller import (
    ACTIVATION_NAMES,
    Constant,
    Controller,
    ControllerError,
    Input,
    Link,
    Node,
    Output,
    Signal,
)
from bitneat.controller.ir import ACCUMULATOR_MAX, MAX_OUTPUTS, MAX_SIGNALS
from tests.strategies import controllers, patient, random_controller


def refused(message: str) -> Any:
    """A context in which a `ControllerError` with just this message must be raised."""
    return pytest.raises(ControllerError, match=f"^{re.escape(message)}$")


def build(*nodes: Node, inputs: int = 2, outputs: tuple[Output, ...] = (Signal(0),), frac_bits: Any = 8) -> Controller:
    return Controller((Input(),) * inputs, nodes, outputs, frac_bits)


class TestRangesAreChecked:
    @pytest.mark.parametrize("frac_bits", [4, 12])
    def test_frac_bits_may_be_4_to_12(self, frac_bits: int) -> None:
        assert build(frac_bits=frac_bits).one == 1 << frac_bits

    @pytest.mark.parametrize("frac_bits", [3, 13, -1])
    def test_frac_bits_may_be_nothing_else(self, frac_bits: int) -> None:
        with refused(f"frac_bits: {frac_bits} is outside 4..12"):
            build(frac_bits=frac_bits)

    @pytest.mark.parametrize(
        ("value", "shown"), [(8.0, "8.0"), ("8", "'8'"), (True, "True"), (None, "None"), (np.int64(8), "int64")]
    )
    def test_an_integer_must_be_an_int(self, value: object, shown: str) -> None:
        with refused(f"frac_bits: expected an integer, got {shown}"):
            build(frac_bits=value)

    def test_a_huge_integer_is_not_printed_out(self) -> None:
        with refused("frac_bits: an integer of 20001 bits is outside 4..12"):
            build(frac_bits=1 << 20000)

    def test_long_text_is_cut_and_kept_on_one_line(self) -> None:
        with pytest.raises(ControllerError) as caught:
            build(frac_bits="a\n" * 1000)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 120

    @pytest.mark.parametrize("limit", [0, -1, 32768])
    def test_a_limit_is_1_to_32767(self, limit: int) -> None:
        with refused(f"inputs[1].limit: {limit} is outside 1..32767"):
            Controller((Input(), Input(limit=limit)), (), (Signal(0),))

    @pytest.mark.parametrize("scale", [-17, 16])
    def test_a_scale_is_within_its_range(self, scale: int) -> None:
        with refused(f"inputs[0].scale: {scale} is outside -16..15"):
            Controller((Input(scale=scale),), (), (Signal(0),))

    @pytest.mark.parametrize("gain", [-8, 8])
    def test_a_gain_is_within_seven(self, gain: int) -> None:
        with refused(f"nodes[0].gain: {gain} is outside -7..7"):
            build(Node(gain=gain))

    @pytest.mark.parametrize("shift", [-1, 8])
    def test_a_shift_is_0_to_7(self, shift: int) -> None:
        with refused(f"nodes[0].links[0].shift: {shift} is outside 0..7"):
            build(Node((Link(0, shift=shift),)))

    @pytest.mark.parametrize("delay", [-1, 2])
    def test_a_delay_is_0_or_1(self, delay: int) -> None:
        with refused(f"nodes[0].links[0].delay: {delay} is outside 0..1"):
            build(Node((Link(0, delay=delay),)))

    @pytest.mark.parametrize(("sign", "shown"), [(0, "0"), (2, "2"), (True, "True"), (1.0, "1.0")])
    def test_a_sign_is_1_or_minus_1(self, sign: Any, shown: str) -> None:
        with refused(f"nodes[0].links[0].sign: {shown} is not -1 or 1"):
            build(Node((Link(0, sign=sign),)))

    @pytest.mark.parametrize("bias", [ACCUMULATOR_MAX + 1, -ACCUMULATOR_MAX - 1])
    def test_a_bias_fits_the_accumulator(self, bias: int) -> None:
        with refused(f"nodes[0].bias: {bias} is outside -2147483647..2147483647"):
            build(Node(bias=bias))

    @pytest.mark.parametrize(("activation", "shown"), [("softplus", "'softplus'"), (3, "3"), (["tanh"], "list")])
    def test_an_activation_is_one_of_ten(self, activation: Any, shown: str) -> None:
        with refused(
            f"nodes[0].activation: {shown} is not one of "
            "identity, clamped, relu, abs, hat, step, tanh, sigmoid, sin, gauss"
        ):
            build(Node(activation=activation))

    @pytest.mark.parametrize("value", [32768, -32768])
    def test_a_constant_output_is_a_signal(self, value: int) -> None:
        with refused(f"outputs[0].constant: {value} is outside -32767..32767"):
            build(outputs=(Constant(value),))

    @pytest.mark.parametrize("index", [-1, 3])
    def test_an_output_names_an_input_or_a_node(self, index: int) -> None:
        with refused(f"outputs[1].signal: {index} is outside 0..2"):
            build(Node(), outputs=(Signal(0), Signal(index)))

    def test_an_output_is_a_signal_or_a_constant(self) -> None:
        with refused("outputs[0]: expected a signal or a constant, got 5"):
            build(outputs=(5,))  # type: ignore[arg-type]


class TestCountsAreChecked:
    def test_there_is_an_input(self) -> None:
        with refused("number of inputs: 0 is outside 1..16383"):
            build(inputs=0, outputs=(Constant(0),))

    def test_there_is_an_output(self) -> None:
        with refused("number of outputs: 0 is outside 1..1024"):
            build(outputs=())

    def test_outputs_are_not_too_many(self) -> None:
        build(outputs=(Signal(0),) * MAX_OUTPUTS)
        with refused(f"number of outputs: {MAX_OUTPUTS + 1} is outside 1..1024"):
            build(outputs=(Signal(0),) * (MAX_OUTPUTS + 1))

    def test_signals_are_not_too_many(self) -> None:
        build(*[Node()] * (MAX_SIGNALS - 2))
        with refused(f"number of inputs and nodes: {MAX_SIGNALS + 1} is outside 1..16383"):
            build(*[Node()] * (MAX_SIGNALS - 1))


class TestLinksAreChecked:
    def test_an_undelayed_link_reads_an_input_or_an_earlier_node(self) -> None:
        build(Node(), Node((Link(0), Link(1), Link(2))))
        for source in (3, 4, 99, -1):
            with refused(f"nodes[1].links[0].source: {source} is not an input or an earlier node (0..2)"):
                build(Node(), Node((Link(source),)), Node())

    def test_a_delayed_link_reads_any_signal(self) -> None:
        build(Node(), Node((Link(0, 1), Link(2, 1), Link(3, 1), Link(4, 1))), Node())
        with refused("nodes[1].links[0].source: 5 is outside 0..4"):
            build(Node(), Node((Link(5, 1),)), Node())

    def test_a_source_is_an_int(self) -> None:
        with refused("nodes[0].links[0].source: True is not an input or an earlier node (0..1)"):
            build(Node((Link(True),)))
        with refused("nodes[0].links[0].source: expected an integer, got 1.0"):
            build(Node((Link(1.0, 1),)))  # type: ignore[arg-type]

    def test_a_source_may_repeat_with_another_shift_or_delay(self) -> None:
        build(Node((Link(0), Link(0, 1), Link(0, 0, 1), Link(0, 1, 1))))

    @pytest.mark.parametrize("sign", [1, -1])
    def test_a_source_may_not_repeat_with_the_same(self, sign: int) -> None:
        with refused("nodes[0].links[2]: source 0 with this delay and shift is there already"):
            build(Node((Link(0, 1, 2), Link(1, 1, 2), Link(0, 1, 2, sign))))


class TestTheAccumulatorRule:
    def test_a_sum_may_just_reach_the_accumulator(self) -> None:
        room = ACCUMULATOR_MAX - (32767 << 7)
        build(Node((Link(0, shift=7),), bias=room))
        build(Node((Link(0, shift=7),), bias=-room))
        for bias in (room + 1, -room - 1):
            with refused("nodes[0]: its sum can reach 2147483648 * 2^0, beyond the accumulator's 2147483647"):
                build(Node((Link(0, shift=7),), bias=bias))

    def test_a_positive_gain_counts(self) -> None:
        build(Node(bias=ACCUMULATOR_MAX >> 7, gain=7))
        with refused("nodes[0]: its sum can reach 16777216 * 2^7, beyond the accumulator's 2147483647"):
            build(Node(bias=(ACCUMULATOR_MAX >> 7) + 1, gain=7))

    def test_a_negative_gain_does_not(self) -> None:
        build(Node(bias=ACCUMULATOR_MAX, gain=-7))

    @pytest.mark.parametrize("activation", ACTIVATION_NAMES)
    def test_a_node_counts_with_the_limit_of_its_activation(self, activation: str) -> None:
        limit = 32767 if activation in ("identity", "relu", "abs") else 256
        room = ACCUMULATOR_MAX - (limit << 3)
        build(Node(activation=activation), Node((Link(2, shift=3),), bias=room))
        with pytest.raises(ControllerError, match=r"^nodes\[1\]: its sum can reach 2147483648 "):
            build(Node(activation=activation), Node((Link(2, shift=3),), bias=room + 1))

    def test_an_input_counts_with_its_own_limit(self) -> None:
        inputs = (Input(limit=10),)
        Controller(inputs, (Node((Link(0),), ACCUMULATOR_MAX - 10),), (Signal(1),))
        with pytest.raises(ControllerError, match=r"^nodes\[0\]: its sum can reach 2147483648 "):
            Controller(inputs, (Node((Link(0),), ACCUMULATOR_MAX - 9),), (Signal(1),))

    def test_a_delayed_link_to_a_later_node_counts(self) -> None:
        later = Node(activation="identity")
        build(Node((Link(3, 1),), ACCUMULATOR_MAX - 32767), later)
        with pytest.raises(ControllerError, match=r"^nodes\[0\]: its sum can reach 2147483648 "):
            build(Node((Link(3, 1),), ACCUMULATOR_MAX - 32766), later)


class TestProperties:
    def test_signals_are_inputs_then_nodes(self) -> None:
        controller = build(Node((Link(0), Link(1))), Node((Link(2),)), inputs=2)
        assert (controller.num_signals, controller.num_links) == (4, 3)

    def test_a_controller_is_ternary_if_all_weights_and_biases_are(self) -> None:
        assert build().is_ternary
        assert build(Node((Link(0, 1, 0, -1),), bias=256, gain=-7), Node(bias=-256)).is_ternary
        assert not build(Node((Link(0, shift=1),))).is_ternary
        assert not build(Node(bias=1)).is_ternary
        assert not build(Node(bias=512)).is_ternary

    def test_a_controller_is_recurrent_if_a_link_is_delayed(self) -> None:
        assert not build(Node((Link(0),))).is_recurrent
        assert build(Node((Link(0),)), Node((Link(0, 1),))).is_recurrent

    def test_a_controller_is_a_frozen_value(self) -> None:
        controller = random_controller(random.Random(5))
        with pytest.raises(dataclasses.FrozenInstanceError):
            controller.frac_bits = 5  # type: ignore[misc]
        assert copy.deepcopy(controller) == controller
        assert pickle.loads(pickle.dumps(controller)) == controller
        assert hash(Controller.from_data(controller.to_data())) == hash(controller)


class TestPlainData:
    @patient
    @given(controllers())
    def test_is_read_back_without_loss(self, controller: Controller) -> None:
        data = controller.to_data()
        assert Controller.from_data(data) == controller
        assert Controller.from_data(json.loads(json.dumps(data))) == controller

    def test_of_seeded_controllers_is_read_back_without_loss(self) -> None:
        for seed in range(100):
            controller = random_controller(random.Random(seed))
            assert Controller.from_data(json.loads(json.dumps(controller.to_data()))) == controller, f"seed {seed}"

    def test_looks_like_this(self) -> None:
        controller = Controller(
            (Input(), Input(-2, 1280)),
            (Node((Link(0, 0, 3, -1), Link(2, 1)), 5, -1, "tanh"),),
            (Signal(2), Constant(-7)),
            10,
        )
        assert controller.to_data() == {
            "frac_bits": 10,
            "inputs": [{"scale": 0, "limit": 32767}, {"scale": -2, "limit": 1280}],
            "nodes": [
                {
                    "activation": "tanh",
                    "gain": -1,
                    "bias": 5,
                    "links": [
                        {"source": 0, "sign": -1, "shift": 3, "delay": 0},
                        {"source": 2, "sign": 1, "shift": 0, "delay": 1},
                    ],
                }
            ],
            "outputs": [{"signal": 2}, {"constant": -7}],
        }

    def test_may_leave_out_what_has_a_default(self) -> None:
        data = {
            "frac_bits": 8,
            "inputs": [{}],
            "nodes": [{"links": [{"source": 0, "sign": 1}]}],
            "outputs": [{"signal": 1}],
        }
        expected = Controller((Input(0, 32767),), (Node((Link(0, 0, 0, 1),), 0, 0, "clamped"),), (Signal(1),), 8)
        assert Controller.from_data(data) == expected


GOOD = {
    "frac_bits": 8,
    "inputs": [{"scale": 0, "limit": 100}],
    "nodes": [
        {"activation": "tanh", "gain": 0, "bias": 0, "links": [{"source": 0, "sign": 1, "shift": 0, "delay": 0}]}
    ],
    "outputs": [{"signal": 1}],
}


class TestForeignDataIsRefusedByName:
    @pytest.mark.parametrize(
        ("path", "value", "message"),
        [
            (["colour"], 1, "controller: unknown key 'colour' (known: frac_bits, inputs, nodes, outputs)"),
            (["inputs", 0, "offset"], 1, "inputs[0]: unknown key 'offset' (known: scale, limit)"),
            (["nodes", 0, "weights"], 1, "nodes[0]: unknown key 'weights' (known: links, activation, gain, bias)"),
            (
                ["nodes", 0, "links", 0, "weight"],
                1,
                "nodes[0].links[0]: unknown key 'weight' (known: source, sign, shift, delay)",
            ),
            (["outputs", 0, "gain"], 1, "outputs[0]: unknown key 'gain' (known: signal, constant)"),
            (["outputs", 0, 5], 1, "outputs[0]: unknown key 5 (known: signal, constant)"),
            (["outputs", 0, "constant"], 1, "outputs[0]: expected one of 'signal' and 'constant'"),
            (["outputs", 0], {}, "outputs[0]: expected one of 'signal' and 'constant'"),
            (["outputs", 0], 7, "outputs[0]: expected a mapping, got 7"),
            (["inputs"], {}, "inputs: expected a list, got dict"),
            (["inputs", 0], [], "inputs[0]: expected a mapping, got list"),
            (["nodes"], "x", "nodes: expected a list, got 'x'"),
            (["nodes", 0, "links"], None, "nodes[0].links: expected a list, got None"),
            (["nodes", 0, "links", 0], 1.5, "nodes[0].links[0]: expected a mapping, got 1.5"),
            (["outputs"], 0, "outputs: expected a list, got 0"),
            (["frac_bits"], 2.0, "frac_bits: expected an integer, got 2.0"),
            (["inputs", 0, "limit"], "9", "inputs[0].limit: expected an integer, got '9'"),
            (["nodes", 0, "gain"], True, "nodes[0].gain: expected an integer, got True"),
            (["nodes", 0, "bias"], 0.5, "nodes[0].bias: expected an integer, got 0.5"),
            (["nodes", 0, "links", 0, "delay"], None, "nodes[0].links[0].delay: expected an integer, got None"),
            (["outputs", 0, "signal"], "a", "outputs[0].signal: expected an integer, got 'a'"),
        ],
    )
    def test_with_the_field_and_what_was_expected(self, path: list[Any], value: object, message: str) -> None:
        data: Any = copy.deepcopy(GOOD)
        assert Controller.from_data(data).num_links == 1
        place = data
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value
        with refused(message):
            Controller.from_data(data)

    @pytest.mark.parametrize(
        ("path", "message"),
        [
            (["frac_bits"], "controller: missing key 'frac_bits'"),
            (["nodes"], "controller: missing key 'nodes'"),
            (["nodes", 0, "links"], "nodes[0]: missing key 'links'"),
            (["nodes", 0, "links", 0, "source"], "nodes[0].links[0]: missing key 'source'"),
            (["nodes", 0, "links", 0, "sign"], "nodes[0].links[0]: missing key 'sign'"),
        ],
    )
    def test_where_a_key_is_missing(self, path: list[Any], message: str) -> None:
        data: Any = copy.deepcopy(GOOD)
        place = data
        for key in path[:-1]:
            place = place[key]
        del place[path[-1]]
        with refused(message):
            Controller.from_data(data)

    @pytest.mark.parametrize("data", [None, [], "controller", 3])
    def test_that_is_no_mapping(self, data: object) -> None:
        with pytest.raises(ControllerError, match=r"^controller: expected a mapping, got "):
            Controller.from_data(data)


class TestShapesAreChecked:
    def test_a_list_in_place_of_a_tuple_is_refused(self) -> None:
        with pytest.raises(ControllerError, match=r"^inputs: expected a tuple, got list$"):
            Controller([Input()], (), (Signal(0),))  # type: ignore[arg-type]

    def test_an_element_of_another_kind_is_refused_by_its_place(self) -> None:
        with pytest.raises(ControllerError, match=r"^nodes\[0\].links\[1\]: expected a link, got 3$"):
            Controller((Input(),), (Node((Link(0), 3)),), (Signal(0),))  # type: ignore[arg-type]


@given(controllers())
def test_a_controller_comes_back_from_a_pickle_with_what_was_known_of_it(controller: Controller) -> None:
    fresh = pickle.loads(pickle.dumps(controller))
    assert fresh == controller
    assert "sha256" not in fresh.__dict__
    assert fresh.sha256 == controller.sha256
    known = pickle.loads(pickle.dumps(controller.canonical))
    assert known.canonical is known
    assert known.sha256 == controller.sha256
    assert copy.deepcopy(controller) == controller


class TestSteps:
    accumulator = Controller((Input(),), (Node((Link(0), Link(1, 1)), activation="identity"),), (Signal(1),))

    def test_a_state_is_brought_up_to_date(self) -> None:
        state = self.accumulator.new_state()
        assert state.signals == [0, 0]
        assert [self.accumulator.step([x], state) for x in (5, 7, -2)] == [[5], [12], [10]]
        assert state.signals == [-2, 10]
        assert self.accumulator.step([1], self.accumulator.new_state()) == [1]

    def test_a_controller_with_delayed_links_needs_a_state(self) -> None:
        with refused("step: a controller with delayed links needs a state; make one with new_state()"):
            self.accumulator.step([5])

    def test_a_controller_without_needs_none_and_takes_one(self) -> None:
        plain = build(Node((Link(0), Link(1, sign=-1)), activation="identity"), outputs=(Signal(2),))
        state = plain.new_state()
        assert plain.step([5, 7]) == plain.step([5, 7], state) == [-2]
        assert state.signals == [5, 7, -2]

    def test_a_state_of_another_controller_is_refused(self) -> None:
        with refused("step: the state has 3 signals, the controller 2"):
            self.accumulator.step([5], build(Node()).new_state())
