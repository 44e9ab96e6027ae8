# SPDX-License-Identifier: MIT
"""A layered network that is trained in floating point but computes with a controller's weights, and the controller that it is.

A node's weights and bias are integers from -(2^p - 1) to 2^p - 1 times one power of two, so that a controller has them exactly: p
binary planes of links with weights ±1 and a bias of ±1, the plane of 2^k through an identity node of gain k, and the node's own
gain. The forward pass uses the integers, the backward pass the real numbers behind them (straight-through: Bengio, Léonard and
Courville 2013).

Importing this needs PyTorch.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import nn
from torch.nn.functional import hardtanh, linear

from bitneat.controller import Controller, Input, Link, Node, Signal
from bitneat.controller.ir import GAIN_RANGE
from bitneat.distill.layers import FRAC_BITS, LIMIT, layers_of
from bitneat.distill.rounding import round_row

_LEAST_SHIFT = -4
"""How many powers of two an input that matters little may be scaled by less than the one that matters most."""

_CLIPPED = 1.2
"""Beyond this a node is clamped whatever a small error does, so such samples hardly count."""
_CLIPPED_WEIGHT = 0.03
_DAMPING = 1e-4
"""What keeps a layer's weights near the real ones where the samples do not say what they should be."""


class QuantizedLinear(nn.Module):
    """A layer whose rows have integer weights and an integer bias times a power of two.

    Args:
        inputs: columns.
        outputs: rows.
        planes: p; integers are at most 2^p - 1.
    """

    def __init__(self, inputs: int, outputs: int, planes: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.randn(outputs, inputs) / math.sqrt(inputs))
        self.bias = nn.Parameter(torch.zeros(outputs))
        self.register_buffer("exponents", torch.zeros(outputs))
        self.largest = float((1 << planes) - 1)
        self.planes = planes
        self.quantized = False

    def quantize(self, on: bool) -> None:
        """Whether to compute with the integers; if so, each row's power of two is now the one with the least squared error."""
        self.quantized = on
        if not on:
            return
        with torch.no_grad():
            candidates = torch.arange(GAIN_RANGE[0], GAIN_RANGE[1] + 1, dtype=torch.float32)[:, None, None]
            both = torch.cat((self.weight, self.bias[:, None]), dim=1)
            error = ((self._rounded(both, candidates) * torch.exp2(candidates) - both) ** 2).sum(2)
            self.exponents.copy_(candidates[error.argmin(0), 0, 0])

    def set_row(self, row: int, integers: Sequence[int], exponent: int) -> None:
        """Let a row's weights and, last, its bias be integers times a power of two."""
        with torch.no_grad():
            values = torch.tensor([math.ldexp(int(x), exponent) for x in integers])
            self.weight[row], self.bias[row], self.exponents[row] = values[:-1], values[-1], float(exponent)

    def _rounded(self, values: Any, exponents: Any) -> Any:
        return torch.round(values / torch.exp2(exponents)).clamp(-self.largest, self.largest)

    def integers(self) -> tuple[Any, Any, Any]:
        """Integer weights (outputs, inputs), integer biases (outputs,) and exponents of two (outputs,)."""
        weights = self._rounded(self.weight, self.exponents[:, None])
        biases = self._rounded(self.bias, self.exponents)
        bits = weights.abs().int()
        kept = torch.ones_like(biases, dtype=torch.int32)
        for plane in range(1, self.planes):  # a node of a bias alone would be a constant, which is no longer ternary
            kept |= (bits >> plane & 1).amax(1) << plane
        return weights, biases.sign() * (biases.abs().int() & kept), self.exponents

    def forward(self, x: Any) -> Any:
        """(n, inputs) to (n, outputs)."""
        if not self.quantized:
            return linear(x, self.weight, self.bias)
        weights, biases, exponents = self.integers()
        scale = torch.exp2(exponents)
        # The value of the integers, the gradient of the real numbers.
        weight = self.weight + (weights * scale[:, None] - self.weight).detach()
        bias = self.bias + (biases * scale - self.bias).detach()
        return linear(x, weight, bias)


class Student(nn.Module):
    """Layers of clamped nodes over rounded observations; it begins with real weights.

    Args:
        scales: of the inputs: an observation counts 2^scale times.
        hidden: nodes of each hidden layer.
        num_outputs: nodes of the last.
        planes: as of `QuantizedLinear`.
        shifts: how much of each scale it was given by `balanced`, which lets it be clipped that much later.
    """

    def __init__(
        self,
        scales: Sequence[int],
        hidden: Sequence[int],
        num_outputs: int,
        planes: int,
        shifts: Sequence[int] | None = None,
    ) -> None:
        super().__init__()
        self.scales, self.hidden, self.num_outputs, self.planes = tuple(scales), tuple(hidden), num_outputs, planes
        self.shifts = tuple(shifts or [0] * len(scales))
        self.limits = tuple(int(LIMIT * 2.0**shift) for shift in self.shifts)
        self.register_buffer("_factor", torch.tensor([2.0 ** (FRAC_BITS + s) for s in scales]), persistent=False)
        self.register_buffer("_limit", torch.tensor(self.limits, dtype=torch.float32), persistent=False)
        sizes = [len(self.scales), *hidden, num_outputs]
        self.layers = nn.ModuleList(QuantizedLinear(a, b, planes) for a, b in pairwise(sizes))

    def state(self) -> dict[str, Any]:
        """Tensors and plain data, from which `from_state` makes it again; whether it is quantized is not among them."""
        tensors = {name: value.detach().clone() for name, value in self.state_dict().items()}
        return {"scales": list(self.scales), "shifts": list(self.shifts), "tensors": tensors}

    @classmethod
    def from_state(cls, state: dict[str, Any], hidden: Sequence[int], num_outputs: int, planes: int) -> Student:
        """Read what `state` wrote."""
        student = cls(state["scales"], hidden, num_outputs, planes, state["shifts"])
        student.load_state_dict(state["tensors"])
        return student

    @classmethod
    def from_controller(cls, controller: Controller, planes: int) -> Student:
        """The network that a controller is, but for rounding, with real weights that go on from its own.

        Links that skip a layer are left out.

        Raises:
            BitneatError: as of `layers_of`.
        """
        layers = layers_of(controller)
        # An input that `balanced` has scaled has a limit that tells by how much.
        scales = [scale - shift for scale, shift in zip(layers.scales, layers.shifts, strict=True)]
        student = cls(scales, layers.hidden, len(controller.outputs), planes)
        with torch.no_grad():
            for layer, (weights, biases) in zip(student.layers, layers.matrices, strict=True):
                layer.weight.copy_(torch.from_numpy(weights))
                layer.bias.copy_(torch.from_numpy(biases))
            student.layers[0].weight *= torch.exp2(torch.tensor(layers.shifts, dtype=torch.float32))
        return student

    def adopt(self, other: Student) -> None:
        """Become another student with the same layers, in the tensors that this one has, which an optimizer may know."""
        self.load_state_dict(other.state_dict())
        self.scales, self.shifts, self.limits = other.scales, other.shifts, other.limits
        self._factor.copy_(other._factor)
        self._limit.copy_(other._limit)
        for mine, its in zip(self.layers, other.layers, strict=True):
            mine.quantized = its.quantized

    @property
    def rounded_layers(self) -> int:
        """How many layers compute with integers."""
        return sum(layer.quantized for layer in self.layers)

    def quantize(self, on: bool) -> None:
        """As `QuantizedLinear.quantize`, in every layer."""
        for layer in self.layers:
            layer.quantize(on)

    def balanced(self) -> Student:
        """The same function but for rounding, with the inputs scaled so that the first layer's columns are about the same size.

        A row's integers share one power of two, and inputs that matter much beside others that matter little would take all of it.
        """
        with torch.no_grad():
            size = self.layers[0].weight.square().mean(0).sqrt().clamp(min=1e-6)
            # Sums of signals are clipped, too, so the largest must not become much larger; nor the smallest too coarse.
            shifts = torch.round(torch.log2(size / size.max())).clamp(min=_LEAST_SHIFT) + 1.0
            whole = [int(shift) for shift in shifts]
            scales = [scale + shift for scale, shift in zip(self.scales, whole, strict=True)]
            student = Student(scales, self.hidden, self.num_outputs, self.planes, whole)
            student.load_state_dict(self.state_dict())
            student.layers[0].weight /= torch.exp2(shifts)
        return student

    def rounded(
        self, observations: npt.NDArray[np.float32], rng: np.random.Generator, layers: int | None = None
    ) -> Student:
        """A student with integers that does what this one with real weights does, nearly.

        A layer reads what the rounded layers below make of the observations, and is fitted to the sums of the real network.
        Layers that have integers already keep them.

        Args:
            observations: (n, inputs) where it goes.
            rng: for the orders of rounding.
            layers: so many from below get integers, and those above only the real weights that fit; all if not given.
        """
        result = copy.deepcopy(self) if self.layers[0].quantized else self.balanced()
        count = len(self.layers) if layers is None else layers
        with torch.no_grad():
            real = result.inputs(torch.from_numpy(observations)).numpy().astype(np.float64)
            seen = real
            for number, layer in enumerate(result.layers):
                sums = real @ layer.weight.numpy().astype(np.float64).T + layer.bias.numpy().astype(np.float64)
                if not layer.quantized:
                    for row in range(len(layer.weight)):
                        _fit(
                            layer, row, seen, sums[:, row], refit=seen is not real, rng=rng if number < count else None
                        )
                    layer.quantized = number < count
                real = np.clip(sums, -1.0, 1.0)
                seen = layer(torch.from_numpy(seen.astype(np.float32))).clamp(-1.0, 1.0).numpy().astype(np.float64)
        return result

    def inputs(self, observations: Any) -> Any:
        """What the first layer reads: scaled, rounded and clipped as the controller's inputs are."""
        return torch.clamp(torch.round(observations * self._factor), -self._limit, self._limit) / (1 << FRAC_BITS)

    def before_clamping(self, observations: Any) -> Any:
        """The sums of the last layer's nodes: observations (n, inputs) to (n, outputs)."""
        x = self.inputs(observations)
        for layer in list(self.layers)[:-1]:
            x = hardtanh(layer(x))
        return self.layers[-1](x)

    def forward(self, observations: Any) -> Any:
        """The outputs, in -1 to 1."""
        return hardtanh(self.before_clamping(observations))

    def act(self, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """`forward` on arrays."""
        with torch.no_grad():
            actions: npt.NDArray[np.float32] = self(torch.from_numpy(observations)).numpy()
        return actions

    def controller(self) -> Controller:
        """The controller that this network is, but for its signals' rounding."""
        nodes: list[Node] = []
        first, count = 0, len(self.scales)
        for layer in self.layers:
            weights, biases, exponents = (np.asarray(x.detach().numpy(), np.int64) for x in layer.integers())
            sources = range(first, first + count)
            sums = []
            for row, bias, exponent in zip(weights, biases, exponents, strict=True):
                links, least = [], 0
                for plane in range(layer.planes):
                    chosen = np.flatnonzero(np.abs(row) >> plane & 1)
                    own = [Link(sources[i], 0, 0, int(np.sign(row[i]))) for i in chosen]
                    constant = int(np.sign(bias) * (abs(bias) >> plane & 1)) << FRAC_BITS
                    if plane == 0:
                        links, least = own, constant
                    elif own or constant:
                        links.append(Link(len(self.scales) + len(nodes), 0, 0, 1))
                        nodes.append(Node(tuple(sorted(own)), constant, plane, "identity"))
                sums.append(Node(tuple(sorted(links)), least, int(exponent), "clamped"))
            first, count = len(self.scales) + len(nodes), len(sums)
            nodes += sums
        inputs = tuple(Input(scale, limit) for scale, limit in zip(self.scales, self.limits, strict=True))
        outputs = tuple(Signal(first + i) for i in range(count))
        return Controller(inputs, tuple(nodes), outputs, FRAC_BITS).canonical


def _fit(
    layer: QuantizedLinear,
    row: int,
    seen: npt.NDArray[np.float64],
    sums: npt.NDArray[np.float64],
    *,
    refit: bool,
    rng: np.random.Generator | None,
) -> None:
    """Give a row the weights with which it makes the sums, (n,), of what it sees, (n, inputs): integers, if there is an ``rng``."""
    columns = np.concatenate((seen, np.ones((len(seen), 1))), axis=1)
    weights = np.where(np.abs(sums) < _CLIPPED, 1.0, _CLIPPED_WEIGHT)[:, None]
    gram = (columns * weights).T @ columns / len(columns)
    target = np.append(layer.weight[row].numpy(), layer.bias[row].numpy()).astype(np.float64)
    if refit:  # what the rounded layers below make of the observations is not what the real ones do
        damping = _DAMPING * np.trace(gram) / len(target)
        right = (columns * weights).T @ sums / len(columns) + damping * target
        target = np.linalg.solve(gram + damping * np.eye(len(target)), right)
    if rng is None:
        values = torch.from_numpy(target.astype(np.float32))
        layer.weight[row], layer.bias[row] = values[:-1], values[-1]
    else:
        found = round_row(target, gram, layer.planes, rng)
        layer.set_row(row, found.integers.tolist(), found.exponent)
