# SPDX-License-Identifier: MIT
"""The network that is trained and the controller that it becomes are the same function, but for rounding.

Runs where bitneat[baselines] is installed: ``make test-baselines``.
"""

from __future__ import annotations

import numpy as np
import pytest

from bitneat.controller import Reference

torch = pytest.importorskip("torch", reason="needs bitneat[baselines]")

from bitneat.distill.student import LIMIT, QuantizedLinear, Student  # noqa: E402 - it needs PyTorch


@pytest.mark.parametrize("planes", [1, 2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_a_student_is_its_controller(planes: int, seed: int) -> None:
    torch.manual_seed(seed)
    student = Student([0, 1, 3, -1, 2], [9, 6], 3, planes)
    with torch.no_grad():
        for layer in student.layers:
            layer.bias += 0.4 * torch.randn(len(layer.bias))
    controller = student.controller()
    assert controller.is_ternary
    assert len(controller.outputs) == 3
    rng = np.random.default_rng(seed)
    observations = rng.normal(0.0, 0.8, (200, 5)).astype(np.float32)
    scales = 2.0 ** (8 + np.array([0, 1, 3, -1, 2]))
    signals = np.clip(np.round(observations * scales), -LIMIT, LIMIT).astype(int)
    reference = Reference(controller)
    found = np.array([reference.step(row.tolist()) for row in signals]) / 256
    with torch.no_grad():
        expected = student(torch.from_numpy(observations)).numpy()
    assert np.abs(np.clip(found, -1.0, 1.0) - expected).max() < 0.05  # rounding down, over three layers
    assert np.abs(expected).mean() > 0.1


@pytest.mark.parametrize("planes", [1, 2, 3])
def test_weights_are_integers_times_a_power_of_two(planes: int) -> None:
    torch.manual_seed(7)
    layer = QuantizedLinear(40, 6, planes)
    weights, biases, exponents = (x.detach().numpy() for x in layer.integers())
    largest = 2**planes - 1
    assert set(np.unique(weights)) <= set(range(-largest, largest + 1))
    assert np.abs(weights).max() == largest
    assert set(np.unique(biases)) <= {-1.0, 0.0, 1.0}
    with torch.no_grad():
        out = layer(torch.eye(40)).numpy().T - layer(torch.zeros(1, 40)).numpy().T
    assert np.allclose(out, weights * 2.0 ** exponents[:, None], atol=1e-6)
    error = np.abs(out - layer.weight.detach().numpy()).mean() / np.abs(layer.weight.detach().numpy()).mean()
    assert error < {1: 0.5, 2: 0.35, 3: 0.18}[planes]


def test_gradients_pass_through_the_integers() -> None:
    layer = QuantizedLinear(3, 2, 2)
    layer(torch.ones(1, 3)).sum().backward()
    assert torch.equal(layer.weight.grad, torch.ones(2, 3))
    assert torch.equal(layer.bias.grad, torch.ones(2))
