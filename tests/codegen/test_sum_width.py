# SPDX-License-Identifier: MIT
"""Where sums may be as narrow as an int of 16 bits."""

import pytest

from bitneat.codegen.interpreter import fits_unsigned
from bitneat.controller import Controller, Input, Link, Node, Signal


@pytest.mark.parametrize(("activation", "fits"), [("clamped", True), ("identity", False)])
def test_a_clip_to_a_whole_signal_does_not_fit_sixteen_bits(activation: str, fits: bool) -> None:
    node = Node((Link(0, 0, 0, 1), Link(1, 0, 0, 1)), 0, 0, activation)
    controller = Controller((Input(0, 1000), Input(0, 1000)), (node,), (Signal(2),), 8).canonical
    assert fits_unsigned(controller, "bytes") is fits
