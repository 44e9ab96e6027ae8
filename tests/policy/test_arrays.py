# SPDX-License-Identifier: MIT
"""Layers in npz files, of friends and of others."""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bitneat.errors import BitneatError
from bitneat.policy import archive
from bitneat.policy.arrays import read_layers, read_normalization
from bitneat.policy.layers import layered_network


def saved(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def zipped(**members: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return buffer.getvalue()


def npy(header: str, data: bytes = b"") -> bytes:
    text = header.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


def test_layers_come_as_they_were_saved() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(3, 2)), np.asfortranarray(rng.normal(size=(1, 3)).astype(np.float32))
    layers = read_layers(saved(W1=first, W2=second, b2=np.array([4])), "tanh", "clamped")
    assert [layer.activation for layer in layers] == ["tanh", "clamped"]
    assert (layers[0].weights == first).all()
    assert (layers[1].weights == second).all()
    assert (layers[0].bias.tolist(), layers[1].bias.tolist()) == ([0.0] * 3, [4.0])


def test_normalization_in_the_file_is_folded_in() -> None:
    weights, mean, var = np.array([[2.0, -1.0]]), np.array([1.0, 3.0]), np.array([4.0, 0.25])
    network = layered_network(read_layers(saved(W1=weights, mean=mean, var=var), "tanh", "identity"))
    assert network.step([5.0, 3.5]) == pytest.approx([2 * (4 / 2) - 0.5 / 0.5])


class Payload:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, (str(self.path),)


def test_pickles_in_the_file_are_not_executed(tmp_path: Path) -> None:
    content = saved(W1=np.array([[Payload(tmp_path / "canary")]], dtype=object))
    with pytest.raises(BitneatError, match="W1: expected numbers, got object"):
        read_layers(content, "tanh", "tanh")
    assert not (tmp_path / "canary").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"PK not a zip", "not a zip file"),
        (saved(W1=np.ones((1, 1)))[:-30], "not a zip file"),
        (saved(V1=np.ones((1, 1))), r"member 'V1\.npy' is not one of W1, b1"),
        (saved(W2=np.ones((1, 1))), "has no array W1"),
        (saved(W1=np.ones((1, 1)), W3=np.ones((1, 1))), "has no array W2"),
        (saved(W1=np.ones((1, 1)), b2=np.ones(1)), "the array b2 belongs to no layer"),
        (saved(W1=np.ones((1, 1)), mean=np.ones(1)), "expected both of mean and var"),
        (saved(b1=np.ones(1)), "has no array W1"),
        (saved(W1=np.ones((1, 1, 1))), "more than two axes"),
        (saved(W1=np.ones(3)), "layer 1: expected weights of shape"),
        (saved(W1=np.float64(1.0)), "layer 1: expected weights of shape"),
        (saved(W1=np.ones((0, 2))), "layer 1: expected weights of shape"),
        (saved(W1=np.ones((2, 0))), "num_inputs: expected an integer from 1"),
        (saved(W1=np.ones(3), mean=np.float64(1.0), var=np.float64(1.0)), "normalization: expected"),
        (saved(W1=np.array([["a"]])), "W1: expected numbers"),
        (zipped(W1=b"junk"), "W1: not an array"),
        (zipped(W1=npy("{'descr': '<f8', 'fortran_order': False, 'shape': (99999999, 99999999), }")), "does not fit"),
        (zipped(W1=npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 2), }", b"12345678")), "does not fit"),
        (zipped(W1=npy("__import__('os').mkdir('canary')")), "W1: not an array"),
    ],
)
def test_what_is_no_file_of_layers_is_refused(content: bytes, message: str) -> None:
    with pytest.raises(BitneatError, match=message):
        layered_network(read_layers(content, "tanh", "tanh"))


def test_a_small_file_that_unpacks_to_a_large_one_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_MEMBER_BYTES", 1 << 20)
    bomb = zipped(W1=npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000, 1000), }", b"\0" * 8_000_000))
    assert len(bomb) < 20_000
    with pytest.raises(BitneatError, match="members exceed"):
        read_layers(bomb, "tanh", "tanh")
    monkeypatch.setattr(archive, "_MAX_MEMBERS", 1)
    with pytest.raises(BitneatError, match="more than 1 members"):
        read_layers(saved(W1=np.ones((1, 1)), b1=np.ones(1)), "tanh", "tanh")


def test_a_file_of_normalization_has_a_mean_and_a_variance(tmp_path: Path) -> None:
    path = tmp_path / "norm.npz"
    path.write_bytes(saved(mean=np.ones(2), var=np.ones(2)))
    assert read_normalization(path)[0].tolist() == [1.0, 1.0]
    path.write_bytes(saved(mean=np.ones(2)))
    with pytest.raises(BitneatError, match=r"norm\.npz: expected the arrays mean and var"):
        read_normalization(path)
