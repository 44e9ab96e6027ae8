# SPDX-License-Identifier: MIT
"""Files made to do harm to whoever reads them: run code, fill the memory, never end, or be read as something else."""

from __future__ import annotations

import base64
import io
import json
import pickle
import struct
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np

CANARY = "canary"
"""A file in the working folder that the gadgets make if they are run."""


class _Gadget:
    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        self.call = function, arguments

    def __reduce__(self) -> Any:
        return self.call


def gadget(protocol: int = 4) -> bytes:
    import os

    return pickle.dumps(
        {"format": "bitneat-champion", "version": 1, "x": _Gadget(os.system, f"touch {CANARY}")}, protocol
    )


_SYSTEM = f"cos\nsystem\n(S'touch {CANARY}'\ntR.".encode()

PICKLES: dict[str, bytes] = {
    **{f"gadget of protocol {number}": gadget(number) for number in range(6)},
    "gadget after a frame": b"\x80\x04\x95" + struct.pack("<Q", 1 << 62) + _SYSTEM,
    "gadget by INST": f"(S'touch {CANARY}'\nios\nsystem\n.".encode(),
    "gadget by OBJ": f"(cos\nsystem\nS'touch {CANARY}'\no.".encode(),
    "gadget by NEWOBJ_EX": b"\x80\x04\x8c\x02os\x8c\x06system\x93)}\x92.",
    "gadget by eval": b"\x80\x04\x8c\x08builtins\x8c\x04eval\x93\x8c\x18open('canary','w').close()\x85R.",
    "gadget behind a champion": pickle.dumps({"format": "bitneat-champion"}, 4)[:-1] + b"0" + _SYSTEM,
    "persistent id": b"\x80\x04\x8c\x01x\x51.",
    "extension registry": b"\x80\x04\x82\x01.",
    "a text of 2^62 bytes": b"\x80\x04\x8d" + struct.pack("<Q", 1 << 62) + b".",
    "bytes of 2^62": b"\x80\x04\x8e" + struct.pack("<Q", 1 << 62) + b".",
    "an integer of 2^31 bytes": b"\x80\x04\x8b" + struct.pack("<i", 2**31 - 1) + b"\x01.",
    "an integer of a million digits": b"I" + b"9" * 1_000_000 + b"\n.",
    "an integer of a million bytes": b"\x80\x04}\x8c\x06format\x8b"
    + struct.pack("<i", 1_000_000)
    + b"\x7f" * 1_000_000
    + b"s.",
    "a memo far away": b"\x80\x04}r\xff\xff\xff\xff.",
    "nested tuples": b"\x80\x04)" + b"\x85" * 1_000_000 + b".",
    "nested lists": b"\x80\x04" + b"]" * 200_000 + b"a" * 199_999 + b".",
    "nested marks": b"(" * 1_000_000 + b".",
    "laughs": b"\x80\x04]q\x00" + b"".join(b"]q%c(" % (i + 1) + b"h%c" % i * 9 + b"e" for i in range(90)) + b".",
    "a list in itself": b"\x80\x04]\x94h\x00a.",
    "NaN": pickle.dumps({"format": "bitneat-champion", "version": float("nan")}, 4),
    "zeros": b"\x00" * 1_000_000,
    "nothing": b"",
    "a stop alone": b".",
    "too many values": b"\x80\x04](" + b"N" * 4_000_000 + b"e.",
}

_JSON_HEAD = '{"format": "bitneat-champion", "version": 1, "controller": '
JSONS: dict[str, bytes] = {
    "nested lists": b'{"format": "bitneat-champion", "version": ' + b"[" * 1_000_000,
    "nested objects": b'{"a":' * 1_000_000,
    "NaN": b'{"format": "bitneat-champion", "version": NaN}',
    "an integer of a million digits": b'{"format": "bitneat-champion", "version": ' + b"9" * 1_000_000 + b"}",
    "a huge exponent": b'{"format": "bitneat-champion", "version": 1e999999999}',
    "half of a surrogate pair": b'{"format": "bitneat-champion", "\\ud800": 1}',
    "hundreds of thousands of keys": ("{" + ",".join(f'"{i}":0' for i in range(300_000)) + "}").encode(),
    "a million empty lists": (_JSON_HEAD + "[" + "[]," * 1_000_000 + "[]]}").encode(),
    "bytes that are no text": b'{"format": "\xff\xfe"}',
    "NUL": b'{"format": "bitneat-champion\\u0000"}',
}


def _node(**changed: Any) -> dict[str, Any]:
    return {"nodes": [{"activation": "relu", "gain": 0, "bias": 0, "links": [], **changed}]}


def _link(**changed: Any) -> dict[str, Any]:
    return {"source": 0, "sign": 1, "shift": 0, "delay": 0, **changed}


# What of a controller is not as it should be.
CONTROLLERS: dict[str, dict[str, Any]] = {
    "the same link a hundred thousand times": _node(links=[_link()] * 100_000),
    "a shift of 2^40": _node(links=[_link(shift=1 << 40)]),
    "a source below 0": _node(links=[_link(source=-1)]),
    "a bias of 300 digits": _node(bias=10**300),
    "an activation that is code": _node(activation="__import__('os')"),
    "a frac_bits that is no number": {"frac_bits": True},
    "a limit of 2^63": {"inputs": [{"scale": 0, "limit": 1 << 63}]},
    "outputs that are none": {"outputs": [{"signal": 10**9}]},
    "a hundred thousand inputs": {"inputs": [{"scale": 0, "limit": 5}] * 100_000},
}


def champion_json(controller: dict[str, Any]) -> bytes:
    plain = {
        "frac_bits": 8,
        "inputs": [{"scale": 0, "limit": 5}],
        "nodes": [],
        "outputs": [{"signal": 0}],
        **controller,
    }
    action = {"kind": "box", "low": [-1.0], "high": [1.0], "shape": [1], "dtype": "float32"}
    data = {
        "format": "bitneat-champion",
        "version": 1,
        "controller": plain,
        "environment": None,
        "action": action,
        "provenance": {},
    }
    return json.dumps(data).encode()


def npy(header: str) -> bytes:
    text = header.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def array(kind: str, shape: str) -> bytes:
    """The header of an array of NumPy; its numbers follow."""
    return npy(f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}")


def zipped(members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as file:
        for name, content in members.items():
            file.writestr(name, content)
    return buffer.getvalue()


def objects() -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.array([_Gadget(print)], dtype=object), allow_pickle=True)
    return buffer.getvalue()


def overlapping(size: int, copies: int) -> bytes:
    """A zip whose entries all claim the same compressed bytes: as many times as large as there are entries."""
    kernel = zipped({"W1.npy": b"\0" * size})
    end = kernel.index(b"PK\x05\x06")
    first = kernel.index(b"PK\x01\x02")
    entry = kernel[first:end]
    directory = b"".join(entry.replace(b"W1.npy", f"W{i % 10}.npy".encode()) for i in range(copies))
    tail = bytearray(kernel[end:])
    struct.pack_into("<HHII", tail, 8, copies, copies, len(directory), first)
    return kernel[:first] + directory + bytes(tail)


ARRAYS: dict[str, bytes] = {
    "pickled objects": zipped({"W1.npy": objects()}),
    "a bomb": zipped({"W1.npy": b"\0" * (200 << 20)}),
    "overlapping entries": overlapping(60 << 20, 60_000),
    "thousands of members": zipped({f"{i}.npy": b"" for i in range(5000)}, zipfile.ZIP_STORED),
    "a name that climbs": zipped({"../../W1.npy": b"x"}),
    "an absolute name": zipped({"/etc/W1.npy": b"x"}),
    "a shape beyond everything": zipped({"W1.npy": array("<f8", "(99999999999, 99999999999)")}),
    "a shape below 0": zipped({"W1.npy": array("<f8", "(-1, 8)") + b"\0" * 64}),
    "a header that is code": zipped({"W1.npy": npy(f"__import__('os').system('touch {CANARY}')")}),
    "a nested header": zipped({"W1.npy": b"\x93NUMPY\x02\x00" + struct.pack("<I", 900_000) + b"(" * 900_000}),
    "a header of 2^32 bytes": zipped({"W1.npy": b"\x93NUMPY\x02\x00\xff\xff\xff\xff{"}),
    "a header of objects": zipped({"W1.npy": array("|O", "(1,)") + _SYSTEM}),
    "NaN": zipped({"W1.npy": array("<f8", "(1, 1)") + struct.pack("<d", float("nan"))}),
    "an infinity": zipped({"W1.npy": array("<f8", "(1, 1)") + struct.pack("<d", float("inf"))}),
    "a zip that is cut off": zipped({"W1.npy": objects()})[:-30],
    "PK alone": b"PK\x03\x04",
}  # fmt: skip


def model(state: bytes, data: bytes = b"{}") -> bytes:
    return zipped({"data": data, "policy.pth": state})


def tensors(pickled: bytes) -> bytes:
    return zipped({"archive/data.pkl": pickled, "archive/data/0": b"\0" * 64, "archive/version": b"3"})


def _tensor(size: str, stride: str) -> bytes:
    """A state with one tensor of a storage of 16 floats, its shape and strides as text of pickle operations."""
    storage = b"(X\x07\x00\x00\x00storagectorch\nFloatStorage\nX\x01\x00\x00\x000X\x03\x00\x00\x00cpuK\x10tQ"
    call = (
        b"ctorch._utils\n_rebuild_tensor_v2\n(" + storage + b"K\x00" + size.encode("latin-1") + stride.encode("latin-1")
    )
    return b"\x80\x02}X\x11\x00\x00\x00action_net.weight" + call + b"\x89}tRs."


_SETTINGS = {":serialized:": base64.b64encode(_SYSTEM).decode(), "policy_kwargs": {"activation_fn": "os.system"}}
_CLIMBING = b"X\x01\x00\x00\x000", b"X\x09\x00\x00\x00../../etc"
MODELS: dict[str, bytes] = {
    "a gadget for a state": model(tensors(_SYSTEM)),
    "a gadget for a settings member": model(tensors(b"\x80\x02}."), json.dumps(_SETTINGS).encode()),
    "nested settings": model(tensors(b"\x80\x02}."), b"[" * 1_000_000),
    "a tensor of 2^60 numbers": model(tensors(_tensor("J\xff\xff\xff\x7fJ\xff\xff\xff\x7f\x86", "K\x00K\x00\x86"))),
    "a tensor that reads one number for ever": model(tensors(_tensor("J\x00\x00\x00\x10K\x01\x86", "K\x00K\x00\x86"))),
    "a stride beyond the storage": model(tensors(_tensor("K\x02K\x01\x86", "J\xff\xff\xff\x7fK\x01\x86"))),
    "nested tuples": model(tensors(b"\x80\x02)" + b"\x85" * 190_000 + b".")),
    "a key that climbs": model(tensors(_tensor("K\x01\x85", "K\x01\x85").replace(*_CLIMBING))),
    "a bomb for a state": model(b"\0" * (200 << 20)),
    "a bomb in a state": model(zipped({"archive/data.pkl": b"\0" * (200 << 20)})),
    "no tensors": model(tensors(b"\x80\x02}.")),
}  # fmt: skip

CONFIGURATIONS: dict[str, bytes] = {
    "an integer of a million digits": b"[NEAT]\npop_size = " + b"9" * 1_000_000,
    "a list of a million numbers": b"[evolve]\nrace_episodes = " + b"1 " * 500_000,
    "interpolation": b"[NEAT]\npop_size = %(pop_size)s",
    "a million sections": b"".join(b"[s%d]\n" % i for i in range(80_000)),
    "NaN": b"[evolve]\nfall_reward = inf\nfinish_bonus = nan",
    "no text": b"\xff\xfe\x00",
    "two of a kind": b"[NEAT]\npop_size = 5\npop_size = 6",
    "controls of a terminal": b"[NEAT]\n\x1b]0;x\x07 = 1",
    "too large": b"#" * (1 << 21),
}

SENSORS: dict[str, bytes] = {
    "a huge exponent": b"[[inputs]]\ninput = 0\ncounts = [0, 9]\nscale = 1e999999999\noffset = 0",
    "a tiny tolerance": b"[[inputs]]\ninput = 0\ncounts = [0, 9]\nscale = 1\noffset = 0\ntolerance = 1e-999999999",
    "an integer of a million digits": b"unused_inputs = [" + b"9" * 1_000_000 + b"]",
    "nested lists": b"unused_inputs = " + b"[" * 100_000,
    "nested tables": b"[" + b"a." * 100_000 + b"a]",
    "NaN": b"[[inputs]]\ninput = 0\nconstant = nan",
    "a name that ends the comment": b'[[inputs]]\ninput = 0\ncounts = [0, 9]\nscale = 1\noffset = 0\nname = "*/ int x; /*"',
}

TABLES: dict[str, bytes] = {
    "no numbers": b"best,mean,selection,steps\na,b,c,d\n",
    "NaN": b"best,mean,selection,steps\nnan,nan,nan,nan\n",
    "NUL": b"best,mean,selection,steps\n1,2,3,\x00\n",
    "a field of megabytes": b"best,mean,selection,steps\n" + b"1" * 2_000_000 + b",2,3,4\n",
    "a quote without an end": b'best,mean,selection,steps\n"' + b"x" * 2_000_000,
    "a huge number": b"best,mean,selection,steps\n1e999,2,3,4\n",
    "too large": b"best,mean,selection,steps\n" + b"1,2,3,4\n" * (5 << 20),
}
