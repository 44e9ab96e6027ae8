# SPDX-License-Identifier: MIT
"""The reference: what a controller computes, in exact Python integers, written to be read.

Everything that bitneat generates or runs is judged against this module; `docs/semantics.md` says the same in words.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from operator import index

from bitneat.controller.activation import evaluate
from bitneat.controller.ir import SIGNAL_MAX, Constant, Controller, Node
from bitneat.errors import BitneatError


class Reference:
    """A controller that runs: `step` maps input signals to output signals and keeps the state of delayed links."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self._previous: list[int] = []
        self.signals: list[int] = []
        """Every input and node after the last step, for inspection."""
        self.reset()

    def reset(self) -> None:
        """Forget the past: every delayed link reads 0 next."""
        self._previous = [0] * self.controller.num_signals
        self.signals = list(self._previous)

    def step(self, inputs: Sequence[int]) -> list[int]:
        """One control step.

        Args:
            inputs: one signal for each input, each within its limit.

        Raises:
            BitneatError: if an input is missing or outside its limit.
        """
        # The state is committed only now, so that a delayed link reads the step before wherever its source stands.
        self._previous = self.signals = evaluate_signals(self.controller, inputs, self._previous)
        return outputs_of(self.controller, self.signals)

    def run(self, sequence: Iterable[Sequence[int]]) -> list[list[int]]:
        """The outputs of a whole sequence of steps, from reset."""
        self.reset()
        return [self.step(inputs) for inputs in sequence]


def evaluate_signals(controller: Controller, inputs: Sequence[int], previous: Sequence[int]) -> list[int]:
    """Every input and node in one step, given all of them in the step before (zeros after reset).

    Raises:
        BitneatError: if an input is missing or outside its limit.
    """
    try:
        signals = [index(x) for x in inputs]
    except TypeError:
        raise BitneatError("step: expected integers, as Encoder makes them of an observation") from None
    if len(signals) != len(controller.inputs):
        raise BitneatError(f"step: expected {len(controller.inputs)} inputs, got {len(signals)}")
    for place, (x, entry) in enumerate(zip(signals, controller.inputs, strict=True)):
        if abs(x) > entry.limit:
            raise BitneatError(f"step: inputs[{place}] is {x}, outside its limit of ±{entry.limit}")
    for node in controller.nodes:
        signals.append(node_value(node, signals, previous, controller.frac_bits))
    return signals


def outputs_of(controller: Controller, signals: Sequence[int]) -> list[int]:
    """The outputs, given every input and node."""
    return [output.value if isinstance(output, Constant) else signals[output.index] for output in controller.outputs]


def node_value(node: Node, signals: Sequence[int], previous: Sequence[int], frac_bits: int) -> int:
    """The value of one node, given the signals before it in this step and all signals of the previous one."""
    accumulator = node.bias
    for link in node.links:
        source = previous[link.source] if link.delay else signals[link.source]
        accumulator += link.sign * (source << link.shift)
    return evaluate(node.activation, saturate(apply_gain(accumulator, node.gain)), frac_bits)


def apply_gain(accumulator: int, gain: int) -> int:
    """``accumulator * 2^gain``, rounded down."""
    return accumulator << gain if gain >= 0 else accumulator >> -gain


def saturate(value: int) -> int:
    """Clip to the range of a signal."""
    return max(-SIGNAL_MAX, min(SIGNAL_MAX, value))
