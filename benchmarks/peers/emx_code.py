# SPDX-License-Identifier: MIT
"""emx-onnx-cgen's code as candidates: the network as an ONNX model, in float and in 8-bit integers."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.candidate import Candidate, CannotExpressError
from benchmarks.peers.networks import levels
from bitneat.controller import Constant, Controller
from bitneat.controller.ir import SIGNAL_MAX

BYTE_ONE = 127


class _Graph:
    """An ONNX graph of levels, each appended to the signals before it."""

    def __init__(self, controller: Controller, element: int, array: type) -> None:
        self.controller = controller
        self.element = element
        self.array = array
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.order = list(range(len(controller.inputs)))
        self.current = "x"
        self.serial = 0

    def constant(self, value: Any, dtype: Any) -> str:
        from onnx import numpy_helper

        self.serial += 1
        self.constants.append(numpy_helper.from_array(np.array(value, dtype), f"k{self.serial}"))
        return f"k{self.serial}"

    def apply(self, operator: str, *inputs: str, **attributes: Any) -> str:
        from onnx import helper

        self.serial += 1
        self.nodes.append(helper.make_node(operator, list(inputs), [f"t{self.serial}"], **attributes))
        return f"t{self.serial}"

    def matrix(self, signals: Sequence[int], dtype: Any, gains: bool) -> str:
        result = np.zeros((len(self.order), len(signals)), dtype)
        for column, signal in enumerate(signals):
            node = self.controller.nodes[signal - len(self.controller.inputs)]
            for link in node.links:
                weight = link.sign * 2.0 ** (link.shift + (node.gain if gains else 0))
                result[self.order.index(link.source), column] += weight
        return self.constant(result, dtype)

    def append(self, value: str, signals: Sequence[int]) -> None:
        self.current = self.apply("Concat", self.current, value, axis=1)
        self.order += signals

    def model(self) -> bytes:
        import onnx
        from onnx import helper

        outputs = [output.index for output in self.controller.outputs if not isinstance(output, Constant)]
        chosen = self.constant([self.order.index(output) for output in outputs], np.int64)
        self.nodes.append(helper.make_node("Gather", [self.current, chosen], ["y"], axis=1))
        graph = helper.make_graph(
            self.nodes,
            "net",
            [helper.make_tensor_value_info("x", self.element, [1, len(self.controller.inputs)])],
            [helper.make_tensor_value_info("y", self.element, [1, len(outputs)])],
            self.constants,
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
        model.ir_version = 8
        onnx.checker.check_model(model)
        text: bytes = model.SerializeToString()
        return text


def emx_float(controller: Controller) -> Candidate:
    """Signals as whole float numbers: sums and gains are exact, and a floor rounds as the reference does."""
    from onnx import TensorProto

    _refuse_state(controller)
    graph = _Graph(controller, TensorProto.FLOAT, np.float32)
    first = len(controller.inputs)
    for level in levels(controller):
        for activation in sorted({controller.nodes[signal - first].activation for signal in level}):
            signals = [signal for signal in level if controller.nodes[signal - first].activation == activation]
            nodes = [controller.nodes[signal - first] for signal in signals]
            value = graph.apply("MatMul", graph.current, graph.matrix(signals, np.float32, gains=True))
            if any(node.bias for node in nodes):
                bias = [[node.bias * 2.0**node.gain for node in nodes]]
                value = graph.apply("Add", value, graph.constant(bias, np.float32))
            if any(node.gain < 0 for node in nodes):
                value = graph.apply("Floor", value)
            graph.append(_activation(graph, value, activation), signals)
    note = "exact while sums fit 24 bits"
    return _compiled(graph, "emx-onnx-cgen, float", note, element="float", unit=controller.one)


def _activation(graph: _Graph, value: str, activation: str) -> str:
    one = float(graph.controller.one)
    limits = {"clamped": (-one, one), "identity": (-SIGNAL_MAX, SIGNAL_MAX), "relu": (0, SIGNAL_MAX)}
    if activation == "step":
        # Of whole numbers, those above 0 are 1 or more.
        limits["step"] = (0, 1)
    if activation not in limits:
        raise CannotExpressError(f"{activation} was not put into ONNX")
    low, high = (graph.constant(limit, np.float32) for limit in limits[activation])
    clipped = graph.apply("Clip", value, low, high)
    return graph.apply("Mul", clipped, graph.constant(one, np.float32)) if activation == "step" else clipped


def emx_int8(controller: Controller) -> Candidate:
    """Signals of 8 bits, One being 127: another network, with the same links, and so the same work at less resolution."""
    from onnx import TensorProto

    _refuse_state(controller)
    if any(node.activation != "clamped" or node.gain or node.bias for node in controller.nodes):
        raise CannotExpressError("gains need more than 8 bits")
    graph = _Graph(controller, TensorProto.INT8, np.int8)
    for level in levels(controller):
        value = graph.apply("MatMulInteger", graph.current, graph.matrix(level, np.int8, gains=False))
        low, high = (graph.constant(limit, np.int32) for limit in (-BYTE_ONE, BYTE_ONE))
        clipped = graph.apply("Clip", value, low, high)
        graph.append(graph.apply("Cast", clipped, to=TensorProto.INT8), level)

    def expected(inputs: Sequence[int]) -> list[int]:
        signals = list(inputs)
        for node in controller.nodes:
            total = sum(link.sign * signals[link.source] for link in node.links)
            signals.append(max(-BYTE_ONE, min(BYTE_ONE, total)))
        return [signals[output.index] for output in controller.outputs if not isinstance(output, Constant)]

    note = "another resolution: 1.0 is 127, inputs end there"
    return _compiled(graph, "emx-onnx-cgen, int8", note, element="int8_t", unit=BYTE_ONE, expected=expected)


def _refuse_state(controller: Controller) -> None:
    if controller.is_recurrent or any(isinstance(output, Constant) for output in controller.outputs):
        raise CannotExpressError("no state, no constant outputs")


def _compiled(graph: _Graph, name: str, note: str, *, element: Any, unit: float, expected: Any = None) -> Candidate:
    controller = graph.controller
    with tempfile.TemporaryDirectory(prefix="bitneat-peers-") as folder:
        model, source = Path(folder, "net.onnx"), Path(folder, "net.c")
        model.write_bytes(graph.model())
        subprocess.run(
            [sys.executable, "-m", "emx_onnx_cgen", "compile", "--model-name", "net", model, source],
            check=True,
            capture_output=True,
            cwd=folder,
        )
        text = source.read_text(encoding="utf-8")
    signature = re.search(r"^void (net\w*)\(([^)]*)\)", text, re.MULTILINE)
    if signature is None:
        raise CannotExpressError("its output has no function of that name")
    count = {"in": len(controller.inputs), "out": len(controller.outputs)}
    return Candidate(
        name=name,
        note=note,
        sources={"net.c": text},
        prologue=f"void {signature[1]}({signature[2]});",
        call=f"{signature[1]}(({element} (*)[{count['in']}])input, ({element} (*)[{count['out']}])output);",
        element=element,
        unit=unit,
        expected=expected,
    )
