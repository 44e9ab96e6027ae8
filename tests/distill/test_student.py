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
        student.layers[0].weight[:, 3] *= 8
    if seed % 2:
        student = student.balanced()
    student.quantize(True)
    controller = student.controller()
    assert controller.is_ternary
    assert len(controller.outputs) == 3
    rng = np.random.default_rng(seed)
    observations = rng.normal(0.0, 0.8, (200, 5)).astype(np.float32)
    scales = 2.0 ** (8 + np.array([entry.scale for entry in controller.inputs]))
    limits = np.array([entry.limit for entry in controller.inputs])
    signals = np.clip(np.round(observations * scales), -limits, limits).astype(int)
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
    layer.quantize(True)
    weights, biases, exponents = (x.detach().numpy() for x in layer.integers())
    largest = 2**planes - 1
    assert set(np.unique(weights)) <= set(range(-largest, largest + 1))
    assert np.abs(weights).max() == largest
    assert not biases.any()
    with torch.no_grad():
        out = layer(torch.eye(40)).numpy().T - layer(torch.zeros(1, 40)).numpy().T
    assert np.allclose(out, weights * 2.0 ** exponents[:, None], atol=1e-6)
    error = np.abs(out - layer.weight.detach().numpy()).mean() / np.abs(layer.weight.detach().numpy()).mean()
    assert error < {1: 0.5, 2: 0.35, 3: 0.18}[planes]


@pytest.mark.parametrize("planes", [1, 2, 3])
def test_a_bias_is_an_integer_of_as_many_planes(planes: int) -> None:
    torch.manual_seed(7)
    layer = QuantizedLinear(40, 6, planes)
    with torch.no_grad():
        layer.bias += 0.4 * torch.randn(6)
    layer.quantize(True)
    _, biases, exponents = (x.detach().numpy() for x in layer.integers())
    largest = 2**planes - 1
    assert set(np.unique(biases)) <= set(range(-largest, largest + 1))
    assert np.abs(biases).max() == largest
    with torch.no_grad():
        assert np.allclose(layer(torch.zeros(1, 40)).numpy()[0], biases * 2.0**exponents, atol=1e-6)


def test_an_input_that_matters_much_does_not_take_the_others_bits() -> None:
    torch.manual_seed(5)
    student = Student([0] * 24, [10], 4, 3)
    with torch.no_grad():
        student.layers[0].weight[:, 7] *= 12.0
        student.layers[0].weight *= 0.3
        observations = 0.7 * torch.randn(500, 24)
        expected = student(observations)
        balanced = student.balanced()
        assert torch.abs(balanced(observations) - expected).max() < 0.02
        errors = []
        for one in (student, balanced):
            one.quantize(True)
            errors.append(((one(observations) - expected) ** 2).mean().item())
    assert errors[1] < 0.5 * errors[0]
    assert balanced.scales[7] == 1
    assert min(balanced.scales) == max(balanced.scales[:7] + balanced.scales[8:]) - 1 == -3
    assert all(limit == int(LIMIT * 2.0**scale) for limit, scale in zip(balanced.limits, balanced.scales, strict=True))


@pytest.mark.parametrize("balanced", [False, True])
def test_a_controller_is_its_student_again_with_real_weights(balanced: bool) -> None:
    torch.manual_seed(11)
    student = Student([0, 1, 3, -1, 2], [9, 6], 3, 3)
    with torch.no_grad():
        for layer in student.layers:
            layer.bias += 0.4 * torch.randn(len(layer.bias))
        student.layers[0].weight[:, 3] *= 8
    if balanced:
        student = student.balanced()
        assert any(student.shifts)
    student.quantize(True)
    again = Student.from_controller(student.controller(), 3)
    assert (again.hidden, again.num_outputs, again.planes) == ((9, 6), 3, 3)
    assert not any(layer.quantized for layer in again.layers)
    assert again.scales == tuple(a - b for a, b in zip(student.scales, student.shifts, strict=True))
    observations = (0.8 * torch.randn(300, 5)).float()
    with torch.no_grad():
        expected, found = student(observations), again(observations)
    assert torch.abs(expected).mean() > 0.1
    # Inputs are rounded at another scale now; all else is the same.
    assert torch.abs(found - expected).max() < 0.05
    assert torch.abs(found - expected).mean() < 0.005


def test_gradients_pass_through_the_integers() -> None:
    layer = QuantizedLinear(3, 2, 2)
    layer.quantize(True)
    layer(torch.ones(1, 3)).sum().backward()
    assert torch.equal(layer.weight.grad, torch.ones(2, 3))
    assert torch.equal(layer.bias.grad, torch.ones(2))


@pytest.mark.parametrize("seed", range(3))
def test_a_rounded_student_does_what_the_one_with_real_weights_does(seed: int) -> None:
    torch.manual_seed(seed)
    student = Student([0, 1, 2, 1, 0, 2, 1, 0], [12, 8], 4, 3)
    before = student.state()["tensors"]
    rng = np.random.default_rng(seed)
    common = rng.normal(size=(2000, 2))
    observations = (1.5 + common @ rng.normal(size=(2, 8)) + 0.3 * rng.normal(size=(2000, 8))).astype(np.float32)
    one_by_one = student.balanced()
    one_by_one.quantize(True)
    found = student.rounded(observations, rng)
    wanted = student.act(observations)
    errors = [float(((each.act(observations) - wanted) ** 2).mean()) for each in (found, one_by_one)]
    assert errors[0] < 0.3 * errors[1]
    weights, biases, exponents = (x.detach().numpy() for x in found.layers[0].integers())
    scale = 2.0**exponents
    assert np.array_equal(weights * scale[:, None], found.layers[0].weight.detach().numpy())
    assert np.array_equal(biases * scale, found.layers[0].bias.detach().numpy())
    assert found.controller().is_ternary
    assert all(torch.equal(value, before[name]) for name, value in student.state_dict().items())


def test_rounding_fits_balances_and_looks_at_nodes_where_they_are_not_clamped() -> None:
    errors = []
    for seed in range(8):
        torch.manual_seed(seed)
        student = Student([0, 1, 2, 1, 0, 2, 1, 0], [12, 8], 4, 2)
        with torch.no_grad():
            student.layers[0].weight *= 1.5
            student.layers[0].weight[:, 0] *= 8
            student.layers[1].weight *= 2
        rng = np.random.default_rng(seed)
        common = rng.normal(size=(2000, 2))
        observations = (1.5 + common @ rng.normal(size=(2, 8)) + 0.3 * rng.normal(size=(2000, 8))).astype(np.float32)
        observations[:, 0] /= 8
        found = student.rounded(observations, np.random.default_rng(0))
        errors.append(float(((found.act(observations) - student.act(observations)) ** 2).mean()))
    assert np.mean(errors) < 0.017  # 0.015; 0.019 to 0.021 without any one of the three


def test_a_layer_after_the_other_becomes_integers_and_those_above_make_good_what_that_did() -> None:
    errors = []
    for seed in range(4):
        torch.manual_seed(seed)
        student = Student([0, 1, 2, 1, 0, 2, 1, 0], [12, 8], 4, 1)
        rng = np.random.default_rng(seed)
        common = rng.normal(size=(2000, 2))
        observations = (1.5 + common @ rng.normal(size=(2, 8)) + 0.3 * rng.normal(size=(2000, 8))).astype(np.float32)
        one = student.rounded(observations, rng, 1)
        assert [layer.quantized for layer in one.layers] == [True, False, False]
        plain = student.balanced()
        for name in ("weight", "bias"):
            getattr(plain.layers[0], name).data.copy_(getattr(one.layers[0], name).data)
        wanted = student.act(observations)
        errors.append([float(((each.act(observations) - wanted) ** 2).mean()) for each in (one, plain)])
        two = one.rounded(observations, rng, 2)
        assert [layer.quantized for layer in two.layers] == [True, True, False]
        assert torch.equal(two.layers[0].weight, one.layers[0].weight)
        assert two.scales == one.scales
        weights, _, exponents = (x.detach().numpy() for x in two.layers[1].integers())
        assert np.array_equal(weights * 2.0 ** exponents[:, None], two.layers[1].weight.detach().numpy())
        whole = two.rounded(observations, rng)
        assert whole.rounded_layers == 3
        assert whole.controller().is_ternary
    made_good, as_it_was = np.mean(errors, axis=0)
    assert made_good < 0.7 * as_it_was
