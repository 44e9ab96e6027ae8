# SPDX-License-Identifier: MIT
"""Where sums may be as narrow as an int of 16 bits."""

import re

import pytest

from bitneat.codegen import generate
from bitneat.codegen.interpreter import fits_unsigned
from bitneat.controller import Controller, Input, Link, Node, Signal


@pytest.mark.parametrize(("activation", "fits"), [("clamped", True), ("identity", False)])
def test_a_clip_to_a_whole_signal_does_not_fit_sixteen_bits(activation: str, fits: bool) -> None:
    node = Node((Link(0, 0, 0, 1), Link(1, 0, 0, 1)), 0, 0, activation)
    controller = Controller((Input(0, 1000), Input(0, 1000)), (node,), (Signal(2),), 8).canonical
    assert fits_unsigned(controller, "bytes") is fits


@pytest.mark.parametrize(
    ("limits", "gain", "activation", "fits"),
    [
        ((16000, 16511), 0, "clamped", True),
        ((16000, 16512), 0, "clamped", False),  # One more is added before it is cut off
        ((16383, 16384), 0, "identity", True),
        ((16384, 16384), 0, "identity", False),
        ((16383, 16384), -1, "clamped", True),
        ((16384, 16384), -1, "clamped", False),  # half of it would fit
    ],
)
def test_sums_fit_sixteen_bits_up_to_the_last_that_does(
    limits: tuple[int, int], gain: int, activation: str, fits: bool
) -> None:
    inputs = (*(Input(0, limit) for limit in limits), Input(0, 1000))
    nodes = (Node((Link(0), Link(1)), 0, gain, activation), Node((Link(2), Link(2, shift=1)), 0, gain, "clamped"))
    controller = Controller(inputs, nodes, (Signal(3), Signal(4)), 8).canonical
    assert [node.gain for node in controller.nodes] == [gain, gain]
    assert fits_unsigned(controller, "bytes") is fits
    assert bool(re.search(r"\bunsigned (sum|n)\d", generate(controller, "legs", "unrolled").source)) is fits


@pytest.mark.parametrize(("limit", "fits"), [(2047, True), (2048, False)])
def test_sums_that_are_shifted_to_the_highest_gain_fit_sixteen_bits(limit: int, fits: bool) -> None:
    nodes = (Node((Link(0), Link(1, sign=-1)), 0, -3, "clamped"), Node((Link(0), Link(1)), 0, 0, "clamped"))
    controller = Controller((Input(0, limit), Input(0, limit)), nodes, (Signal(2), Signal(3)), 8).canonical
    assert [node.gain for node in controller.nodes] == [-3, 0]
    assert fits_unsigned(controller, "bytes") is fits


def test_only_records_without_constants_of_their_own_are_summed_in_sixteen_bits() -> None:
    def made(bias: int = 0, activation: str = "clamped") -> Controller:
        nodes = (Node((Link(0), Link(1)), bias, 0, activation), Node((Link(2), Link(0, sign=-1)), 0, 0, "clamped"))
        return Controller((Input(0, 100), Input(0, 100)), nodes, (Signal(3), Signal(2)), 8).canonical

    assert fits_unsigned(made(), "bytes")
    assert fits_unsigned(made(bias=256), "bytes")
    assert not fits_unsigned(made(bias=77), "bytes")
    assert not fits_unsigned(made(activation="relu"), "bytes")
    for encoding in ("rice", "bitmap", "trits"):
        assert not fits_unsigned(made(), encoding)


def test_sums_that_are_only_shifted_up_need_no_common_shift() -> None:
    nodes = (Node((Link(0),), 0, 0, "clamped"), Node((Link(1), Link(2, sign=-1)), 0, 2, "clamped"))
    inputs = (Input(0, 30000), Input(0, 100), Input(0, 100))
    controller = Controller(inputs, nodes, (Signal(3), Signal(4)), 8).canonical
    assert [node.gain for node in controller.nodes] == [0, 2]
    assert fits_unsigned(controller, "bytes")  # although 30000 << 2 would not
