# SPDX-License-Identifier: MIT
"""The tensors in a file that ``torch.save`` wrote of a module's state, read without torch and without Python's unpickler.

Such a file is a zip: ``data.pkl`` is a pickle that builds an ordered dictionary of tensors, and their numbers are members of their
own. This reader knows the few operations and the three names that this needs; everything else is refused.
"""

from __future__ import annotations

import math
import pickletools
from dataclasses import dataclass
from typing import Any

import numpy as np

from bitneat.policy.archive import Archive
from bitneat.policy.layers import Floats, PolicyError

_MAX_OPCODES = 200_000
_MAX_NUMBERS = 4_000_000
"""Of all tensors together; one may read the same number many times."""

_DTYPES = {
    "FloatStorage": "f4",
    "DoubleStorage": "f8",
    "HalfStorage": "f2",
    "LongStorage": "i8",
    "IntStorage": "i4",
    "ShortStorage": "i2",
    "CharStorage": "i1",
    "ByteStorage": "u1",
    "BoolStorage": "u1",
}
_DICTIONARY = ("collections", "OrderedDict")
_TENSOR = ("torch._utils", "_rebuild_tensor_v2")

_SCALARS = frozenset(("BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT", "BINUNICODE"))
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_TUPLES = {"EMPTY_TUPLE": 0, "TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}


def read_state(content: bytes) -> dict[str, Floats]:
    """The tensors by name, in float64.

    Raises:
        PolicyError: if the file is damaged or holds anything but the state of a module. Nothing in it is executed.
    """
    archive = Archive(content)
    pickles = [name for name in archive.names if name.endswith("/data.pkl") and name.count("/") == 1]
    if len(pickles) != 1:
        raise PolicyError("not a file that torch saved: expected one member …/data.pkl")
    folder = pickles[0].removesuffix("data.pkl")
    order = archive.read(f"{folder}byteorder") if f"{folder}byteorder" in archive.names else b"little"
    if order not in (b"little", b"big"):
        raise PolicyError("its byte order is neither little nor big")
    try:
        state = _Machine(archive, folder, "<" if order == b"little" else ">").run(archive.read(pickles[0]))
    except PolicyError:
        raise
    except Exception as error:  # a damaged pickle can make pickletools raise nearly anything
        raise PolicyError(f"a damaged or truncated pickle ({type(error).__name__})") from None
    if not isinstance(state, dict):
        raise PolicyError("expected the state of a module, a dictionary of tensors")
    return {name: tensor for name, tensor in state.items() if isinstance(tensor, np.ndarray)}


@dataclass(frozen=True)
class _Name:
    module: str
    name: str


@dataclass(frozen=True)
class _Storage:
    dtype: str
    key: str


class _Machine:
    """Runs the pickle's operations on a stack of plain values, names, storages and tensors."""

    def __init__(self, archive: Archive, folder: str, order: str) -> None:
        self._archive, self._folder, self._order = archive, folder, order
        self._stack: list[Any] = []
        self._below: list[list[Any]] = []
        self._memo: dict[int, Any] = {}
        self._bytes: dict[str, bytes] = {}
        self._numbers = 0

    def run(self, content: bytes) -> Any:
        for number, (opcode, argument, _) in enumerate(pickletools.genops(content)):
            if number >= _MAX_OPCODES:
                raise PolicyError(f"refused: more than {_MAX_OPCODES} operations")
            name = opcode.name
            if name == "STOP":
                return self._stack.pop()
            self._carry_out(name, argument)
        raise PolicyError("a damaged or truncated pickle (it has no end)")

    def _carry_out(self, name: str, argument: Any) -> None:
        stack = self._stack
        if name in _SCALARS or name in _CONSTANTS:
            stack.append(_CONSTANTS.get(name, argument))
        elif name == "MARK":
            self._below.append(stack)
            self._stack = []
        elif name in _TUPLES:
            self._push_tuple(_TUPLES[name])
        elif name == "TUPLE":
            values, self._stack = stack, self._below.pop()
            self._stack.append(tuple(values))
        elif name == "EMPTY_DICT":
            stack.append({})
        elif name == "SETITEM":
            value, key = stack.pop(), stack.pop()
            self._update([key, value])
        elif name == "SETITEMS":
            values, self._stack = stack, self._below.pop()
            self._update(values)
        elif name in ("BINPUT", "LONG_BINPUT"):
            self._memo[argument] = stack[-1]
        elif name in ("BINGET", "LONG_BINGET"):
            stack.append(self._memo[argument])
        elif name not in ("PROTO", "FRAME"):
            self._make_object(name, argument)

    def _make_object(self, name: str, argument: Any) -> None:
        stack = self._stack
        if name == "GLOBAL":
            stack.append(_Name(*argument.split(" ", 1)))
        elif name == "BINPERSID":
            stack.append(_storage(stack.pop()))
        elif name == "REDUCE":
            arguments, called = stack.pop(), stack.pop()
            stack.append(self._called(called, arguments))
        elif name == "BUILD":
            stack.pop()  # the dictionary's metadata
        else:
            raise PolicyError(f"refused: the pickle uses {name}, which the state of a module does not need")

    def _push_tuple(self, size: int) -> None:
        start = len(self._stack) - size
        values = self._stack[start:]
        del self._stack[start:]
        self._stack.append(tuple(values))

    def _update(self, values: list[Any]) -> None:
        target = self._stack[-1]
        if not isinstance(target, dict) or not all(isinstance(key, str) for key in values[::2]):
            raise PolicyError("a damaged pickle (it sets an item of what is no dictionary)")
        target.update(zip(values[::2], values[1::2], strict=True))

    def _called(self, called: Any, arguments: Any) -> Any:
        if not isinstance(called, _Name):
            raise PolicyError("a damaged pickle (it calls what is no name)")
        if (called.module, called.name) == _DICTIONARY and arguments == ():
            return {}
        if (called.module, called.name) == _TENSOR:
            return self._tensor(*arguments[:4])
        raise PolicyError(f"refused: the pickle calls {called.module!s:.60}.{called.name!s:.60}, which can run code")

    def _tensor(self, storage: Any, offset: Any, size: Any, stride: Any) -> Floats:
        if not isinstance(storage, _Storage):
            raise PolicyError("a damaged pickle (a tensor has no storage)")
        numbers = [offset, *size, *stride]
        if len(size) != len(stride) or len(size) > 4 or any(type(n) is not int or n < 0 for n in numbers):
            raise PolicyError("a tensor's size and strides are malformed")
        dtype = np.dtype(self._order + storage.dtype)
        if storage.key not in self._bytes:
            self._bytes[storage.key] = self._archive.read(f"{self._folder}data/{storage.key}")
        data = self._bytes[storage.key]
        flat = np.frombuffer(data[: len(data) // dtype.itemsize * dtype.itemsize], dtype)
        count = math.prod(size)
        last = offset + sum((n - 1) * step for n, step in zip(size, stride, strict=True))
        self._numbers += count
        if self._numbers > _MAX_NUMBERS or (count and last >= flat.size):
            raise PolicyError(f"a tensor is larger than its storage, or there are more than {_MAX_NUMBERS} numbers")
        if not count:
            return np.zeros(size)
        steps = tuple(step * dtype.itemsize for step in stride)
        return np.lib.stride_tricks.as_strided(flat[offset:], size, steps, writeable=False).astype(np.float64)


def _storage(identity: Any) -> _Storage:
    """What ``("storage", type, key, place, count)`` names."""
    if not isinstance(identity, tuple) or len(identity) != 5 or identity[0] != "storage":
        raise PolicyError("a damaged pickle (it names no storage)")
    kind, key = identity[1], identity[2]
    if not isinstance(kind, _Name) or kind.module != "torch" or not isinstance(key, str):
        raise PolicyError("a damaged pickle (it names no storage)")
    dtype = _DTYPES.get(kind.name)
    if dtype is None:
        raise PolicyError(f"refused: a {kind.name!s:.40}; expected one of {', '.join(_DTYPES)}")
    return _Storage(dtype, key)
