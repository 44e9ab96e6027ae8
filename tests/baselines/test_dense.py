# SPDX-License-Identifier: MIT
"""Dense networks against NumPy's own matrix products and hyperbolic tangent."""

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from bitneat.baselines.dense import DenseNetwork, dense_from_npz
from bitneat.errors import BitneatError
from tests.hostile.files import array, zipped


def random_dense(sizes: tuple[int, ...], hidden: str = "tanh", clipped: bool = True, seed: int = 0) -> DenseNetwork:
    random = np.random.default_rng(seed)
    weights = [random.normal(0.0, 1.0, (out, into)).astype(np.float32) for into, out in pairwise(sizes)]
    return DenseNetwork(
        tuple(weights), tuple(random.normal(0.0, 1.0, len(w)).astype(np.float32) for w in weights), hidden, clipped
    )


def expected(dense: DenseNetwork, x: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    functions = {"tanh": np.tanh, "relu": lambda z: np.maximum(z, 0.0)}
    value = np.asarray(x, np.float64)
    for weights, bias in zip(dense.weights[:-1], dense.biases[:-1], strict=True):
        value = functions[dense.hidden](weights.astype(np.float64) @ value + bias)
    value = dense.weights[-1].astype(np.float64) @ value + dense.biases[-1]
    return np.clip(value, -1.0, 1.0) if dense.clipped else value


@pytest.mark.parametrize(("hidden", "clipped"), [("tanh", True), ("relu", False), ("relu", True), ("tanh", False)])
@pytest.mark.parametrize("sizes", [(24, 4), (5, 7, 3), (24, 16, 8, 4)])
def test_the_network_of_nodes_and_links_computes_what_the_layers_do(
    sizes: tuple[int, ...], hidden: str, clipped: bool
) -> None:
    dense = random_dense(sizes, hidden, clipped)
    network = dense.to_network()
    assert network.num_links == sum(weights.size for weights in dense.weights)
    for x in np.random.default_rng(7).normal(0.0, 0.3, (20, sizes[0])):
        np.testing.assert_allclose(network.step(x.tolist()), expected(dense, x), rtol=1e-12, atol=1e-12)


def test_folding_takes_the_normalisation_into_the_first_layer() -> None:
    random = np.random.default_rng(3)
    mean, deviation = random.normal(0.0, 1.0, 24), random.uniform(0.1, 2.0, 24)
    dense = random_dense((24, 8, 4), clipped=False)
    folded = dense.folded(mean, deviation)
    for x in random.normal(0.0, 1.0, (20, 24)):
        np.testing.assert_allclose(expected(folded, x), expected(dense, (x - mean) / deviation), atol=2e-5)
    assert all(array.dtype == np.float32 for array in (*folded.weights, *folded.biases))


def test_parameters_are_counted_with_biases_and_take_four_bytes_each() -> None:
    dense = random_dense((24, 64, 64, 4))
    assert dense.parameters == 24 * 64 + 64 + 64 * 64 + 64 + 64 * 4 + 4
    assert dense.float_bytes == 4 * dense.parameters


def test_an_npz_file_is_read_back_to_the_bit_and_written_alike_each_time() -> None:
    dense = random_dense((24, 8, 4), "relu", False)
    content = dense.to_npz()
    assert content == random_dense((24, 8, 4), "relu", False).to_npz()
    back = dense_from_npz(content, "relu", False)
    for ours, theirs in zip((*dense.weights, *dense.biases), (*back.weights, *back.biases), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 no archive", random_dense((3, 2)).to_npz()[:100]])
def test_a_damaged_npz_file_is_refused(content: bytes) -> None:
    with pytest.raises(BitneatError, match=r"not an \.npz file"):
        dense_from_npz(content, "tanh", True)


def test_a_small_file_that_unpacks_to_a_large_one_is_refused() -> None:
    with pytest.raises(BitneatError, match=r"not an \.npz file of arrays: refused: its members exceed"):
        dense_from_npz(zipped({"W1.npy": b"\0" * (70 << 20)}), "tanh", True)
    with pytest.raises(BitneatError, match=r"not an \.npz file of arrays: W1: its shape"):
        dense_from_npz(zipped({"W1.npy": array("<f4", "(99999999, 99999999)")}), "tanh", True)


@pytest.mark.parametrize(
    "arrays", [{}, {"W1": np.zeros((2, 3), np.float32)}, {"W1": np.zeros((2, 3)), "b1": np.zeros(2)}]
)
def test_an_npz_file_of_other_arrays_is_refused(arrays: dict[str, Any], tmp_path: Any) -> None:
    np.savez(tmp_path / "other.npz", **arrays)
    with pytest.raises(BitneatError, match="expected float32 arrays W1, b1"):
        dense_from_npz((tmp_path / "other.npz").read_bytes(), "tanh", True)


def test_layers_that_do_not_fit_are_refused_by_number() -> None:
    weights = (np.zeros((3, 5), np.float32), np.zeros((2, 4), np.float32))
    with pytest.raises(BitneatError, match="layer 2"):
        DenseNetwork(weights, (np.zeros(3, np.float32), np.zeros(2, np.float32)))
    with pytest.raises(BitneatError, match="softmax"):
        DenseNetwork(weights[:1], (np.zeros(3, np.float32),), "softmax")
