# SPDX-License-Identifier: MIT
"""Layers in a ``.npz`` file: arrays W1, b1, W2, b2, …, and mean and var of the observations if they were normalized."""

from __future__ import annotations

import io
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bitneat.files import read_capped
from bitneat.policy.archive import MAX_FILE_BYTES, Archive
from bitneat.policy.layers import Floats, Layer, PolicyError, with_normalization

_NAME = re.compile(r"([Wb][1-9][0-9]?|mean|var)\.npy")


def read_layers(content: bytes, hidden: str, output: str) -> list[Layer]:
    """The layers in the bytes of a ``.npz`` file, for observations as they are.

    Args:
        content: of the file. A missing bias is 0.
        hidden: activation of all layers but the last.
        output: activation of the last.

    Raises:
        PolicyError: if an array is missing, unknown or malformed, or there are pickles in it. Nothing in the file is executed.
    """
    arrays = _read(content)
    count = sum(name.startswith("W") for name in arrays)
    layers = []
    for number in range(1, count + 1):
        weights = arrays.pop(f"W{number}", None)
        if weights is None:
            raise PolicyError(f"has no array W{number}; expected W1, b1, W2, b2, … without gaps")
        bias = arrays.pop(f"b{number}", np.zeros(weights.shape[:1]))
        layers.append(Layer(weights, bias, output if number == count else hidden))
    if not layers:
        raise PolicyError("has no array W1; expected W1, b1, W2, b2, …")
    return _normalized(layers, arrays)


def read_normalization(path: Path) -> tuple[Floats, Floats]:
    """``mean`` and ``var`` of a ``.npz`` file.

    Raises:
        BitneatError: if it holds anything else, or cannot be read.
    """
    try:
        arrays = _read(read_capped(path, MAX_FILE_BYTES))
        if set(arrays) != {"mean", "var"}:
            raise PolicyError("expected the arrays mean and var")
    except PolicyError as error:
        raise PolicyError(f"{path}: {error}") from None
    return arrays["mean"], arrays["var"]


def _normalized(layers: list[Layer], rest: dict[str, Floats]) -> list[Layer]:
    mean, variance = rest.pop("mean", None), rest.pop("var", None)
    if rest:
        raise PolicyError(f"the array {min(rest)} belongs to no layer")
    if (mean is None) != (variance is None):
        raise PolicyError("expected both of mean and var, or neither")
    return layers if mean is None or variance is None else with_normalization(layers, mean, variance)


def read_arrays(content: bytes) -> dict[str, npt.NDArray[Any]]:
    """The arrays in the bytes of a ``.npz`` file, by name, as they were saved.

    Raises:
        PolicyError: if one has another name than those of layers, is malformed, or holds anything but numbers.
    """
    archive = Archive(content)
    arrays = {}
    for name in archive.names:
        if not _NAME.fullmatch(name):
            raise PolicyError(f"member {name!r:.80} is not one of W1, b1, W2, b2, …, mean, var")
        arrays[name.removesuffix(".npy")] = _array(name, archive.read(name))
    return arrays


def _read(content: bytes) -> dict[str, Floats]:
    return {name: array.astype(np.float64) for name, array in read_arrays(content).items()}


def _array(name: str, content: bytes) -> npt.NDArray[Any]:
    """An array of numbers in the bytes of a ``.npy`` file; its header is believed only as far as there are bytes."""
    where = name.removesuffix(".npy")
    stream = io.BytesIO(content)
    try:
        version = np.lib.format.read_magic(stream)
        readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        shape, fortran, dtype = readers[version](stream)
    except Exception as error:  # the file may be anyone's
        raise PolicyError(f"{where}: not an array, or a damaged one ({type(error).__name__})") from None
    if dtype.kind not in "fiu":
        raise PolicyError(f"{where}: expected numbers, got {dtype!s:.40}")
    data = content[stream.tell() :]
    if len(shape) > 2 or math.prod(shape) * dtype.itemsize != len(data):
        raise PolicyError(
            f"{where}: its shape {shape!s:.40} does not fit its {len(data)} bytes, or has more than two axes"
        )
    return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")
