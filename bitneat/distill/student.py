# SPDX-License-Identifier: MIT
"""A layered network that is trained in floating point but computes with a controller's weights, and the controller that it is.

A node's weights are integers from -(2^p - 1) to 2^p - 1 times one power of two, so that a controller has them exactly: p binary
planes of links with weights ±1, the plane of 2^k through an identity node of gain k, and the node's own gain. The forward pass
uses the integers, the backward pass the real numbers behind them (straight-through: Bengio, Léonard and Courville 2013).
With one plane the weights are -1, 0 and +1, chosen as in ternary weight networks (Li, Zhang and Liu 2016).

Importing this needs PyTorch.
"""

from __future__ import annotations

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

FRAC_BITS = 8
LIMIT = 2047
"""Of each input, in units of 2^-8: beyond 8 an observation is clipped."""
_THRESHOLD = 0.7
"""Of ternary weights: those below this part of the mean magnitude are zero (Li, Zhang and Liu 2016)."""
_SPREAD = 2.5
"""The largest integer stands for this many mean magnitudes; a normal distribution has 5 % beyond."""


class QuantizedLinear(nn.Module):
    """A layer whose rows have integer weights times a power of two, and a bias of -1, 0 or 1 times the same.

    Args:
        inputs: columns.
        outputs: rows.
        planes: p; weights are integers of at most 2^p - 1.
    """

    def __init__(self, inputs: int, outputs: int, planes: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.randn(outputs, inputs) / math.sqrt(inputs))
        self.bias = nn.Parameter(torch.zeros(outputs))
        self.planes = planes
        self.quantized = True

    def integers(self) -> tuple[Any, Any, Any]:
        """Integer weights (outputs, inputs), integer biases (outputs,) and exponents of two (outputs,)."""
        size = self.weight.abs()
        if self.planes == 1:
            kept = (size > _THRESHOLD * size.mean(1, keepdim=True)).float()
            typical = (size * kept).sum(1) / kept.sum(1).clamp(min=1.0)
            exponents = torch.round(torch.log2(typical)).clamp(*GAIN_RANGE)
            weights = torch.sign(self.weight) * kept
        else:
            largest = (1 << self.planes) - 1
            exponents = torch.round(torch.log2(_SPREAD * size.mean(1) / largest)).clamp(*GAIN_RANGE)
            weights = torch.round(self.weight / torch.exp2(exponents)[:, None]).clamp(-largest, largest)
        biases = torch.round(self.bias / torch.exp2(exponents)).clamp(-1.0, 1.0)
        return weights, biases, exponents

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
    """Layers of clamped nodes over rounded observations.

    Args:
        scales: of the inputs: an observation counts 2^scale times.
        hidden: nodes of each hidden layer.
        num_outputs: nodes of the last.
        planes: as of `QuantizedLinear`.
    """

    def __init__(self, scales: Sequence[int], hidden: Sequence[int], num_outputs: int, planes: int) -> None:
        super().__init__()
        self.scales, self.num_outputs = tuple(scales), num_outputs
        self.register_buffer("_factor", torch.tensor([2.0 ** (FRAC_BITS + s) for s in scales]), persistent=False)
        sizes = [len(self.scales), *hidden, num_outputs]
        self.layers = nn.ModuleList(QuantizedLinear(a, b, planes) for a, b in pairwise(sizes))

    def quantize(self, on: bool) -> None:
        """Whether the forward pass uses the integers."""
        for layer in self.layers:
            layer.quantized = on

    def before_clamping(self, observations: Any) -> Any:
        """The sums of the last layer's nodes: observations (n, inputs) to (n, outputs)."""
        x = torch.round(observations * self._factor).clamp(-LIMIT, LIMIT) / (1 << FRAC_BITS)
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
                links = []
                for plane in range(layer.planes):
                    chosen = np.flatnonzero(np.abs(row) >> plane & 1)
                    own = [Link(sources[i], 0, 0, int(np.sign(row[i]))) for i in chosen]
                    if plane == 0:
                        links += own
                    elif own:
                        links.append(Link(len(self.scales) + len(nodes), 0, 0, 1))
                        nodes.append(Node(tuple(sorted(own)), 0, plane, "identity"))
                sums.append(Node(tuple(sorted(links)), int(bias) << FRAC_BITS, int(exponent), "clamped"))
            first, count = len(self.scales) + len(nodes), len(sums)
            nodes += sums
        inputs = tuple(Input(scale=scale, limit=LIMIT) for scale in self.scales)
        outputs = tuple(Signal(first + i) for i in range(count))
        return Controller(inputs, tuple(nodes), outputs, FRAC_BITS).canonical
