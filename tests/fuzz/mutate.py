# SPDX-License-Identifier: MIT
"""Mutations of files: bytes, the values of plain data, the opcodes of pickles, the lines of ini files."""

from __future__ import annotations

import copy
import json
import pickle
import pickletools
import random
from typing import Any

VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2, 7, 8, 12, 13, 255, 256, 1024, 1025, 16384, 32767, 32768, -32768),
    *(2**31 - 1, 2**31, -(2**31), 2**63, 2**64, 10**400, -(2**1023), 2**1024, 0.0, -0.0, 0.5, 1e-320, 1e308, -1e308),
    *(
        float("nan"),
        float("inf"),
        float("-inf"),
        "",
        "x",
        "0",
        "1e5",
        "\0",
        "\n",
        "\x1b[2J",
        "\ud800",
        "é",
        "\u202e",
        "a" * 300,
    ),
    *([], {}, [[]], [{}], {"": 0}, {"kind": "box"}, [0] * 40, [1.5, "a", None], {"a": {"b": {"c": [1]}}}),
)
"""What a field may hold that it should not, or just about may."""

TOKENS = (
    *(
        b"null",
        b"true",
        b"NaN",
        b"Infinity",
        b"-Infinity",
        b"1e999",
        b"-0",
        b"1e-999",
        b'"\\ud800"',
        b"{}",
        b"[]",
        b"," * 3,
    ),
    *(
        b"[" * 200,
        b'{"a":' * 60,
        b"9" * 5000,
        b"\xff\xfe",
        b"\xef\xbb\xbf",
        b"\x00",
        b"\\u0000",
        b'"\x1b[31m"',
        b"//",
        b"\x1b",
    ),
    *(b"format", b"version", b"controller", b"nodes", b"links", b"inputs", b"outputs", b"kind", b"box", b"discrete"),
)
LINES = (
    *(
        "[DEFAULT]",
        "[evolve]",
        "[NEAT]",
        "[BitGenome]",
        "[PlainGenome]",
        "[\x1b[2J]",
        "[]",
        "[a]b",
        "]",
        "=",
        ":",
        "= 1",
        "a\n b\n c",
    ),
    *(
        "pop_size",
        "pop_size =",
        "pop_size = %(x)s",
        "pop_size = ${x:y}",
        "generations = 1_000",
        "generations = 0x10",
        "generations = \u0661",
    ),
    *(
        "elitism = nan",
        "elitism = inf",
        "race_episodes = 1 2 3",
        "race_episodes =",
        "race_fractions = 1.0 nan",
        "activations = all",
    ),
    *(
        "input_scales = " + "1 " * 3000,
        "max_steps = " + "9" * 5000,
        "fall_reward = none",
        "fall_reward = NONE",
        "\ufeff[evolve]",
        "\0",
    ),
)
OPCODES = tuple(opcode.code.encode("latin-1") for opcode in pickletools.opcodes)
_GLOBALS = (
    b"cos\nsystem\n(S'true'\ntR",
    b"\x8c\x02os\x8c\x06system\x93",
    b"c__builtin__\neval\n",
    b"\x8c\x08builtins\x8c\x04exec\x93",
)


def mutate_bytes(content: bytes, rng: random.Random) -> bytes:
    """One to four changes of bytes: flipped, replaced, cut out, doubled, moved, or a token put in."""
    data = bytearray(content)
    for _ in range(rng.randint(1, 4)):
        if not data:
            data += rng.randbytes(4)
        at = rng.randrange(len(data))
        length = min(rng.choice((1, 1, 2, 4, 16, 100)), len(data) - at)
        match rng.randrange(8):
            case 0:
                data[at] ^= 1 << rng.randrange(8)
            case 1:
                data[at] = rng.randrange(256)
            case 2:
                del data[at : at + length]
            case 3:
                data[at:at] = data[at : at + length] * rng.choice((1, 1, 1, 50))
            case 4:
                piece = data[at : at + length]
                del data[at : at + length]
                to = rng.randrange(len(data) + 1)
                data[to:to] = piece
            case 5:
                data[at : at + rng.choice((0, length))] = rng.choice(TOKENS)
            case 6:
                del data[at:]
            case _:
                data[at : at + length] = rng.randbytes(length)
    return bytes(data)


def mutate_plain(data: Any, rng: random.Random) -> Any:
    """A copy of plain data with one to three of its values replaced, removed, doubled or exchanged."""
    data = copy.deepcopy(data)
    for _ in range(rng.randint(1, 3)):
        places = list(_places(data))
        if not places:
            return rng.choice(VALUES)
        holder, key = rng.choice(places)
        match rng.randrange(8):
            case 0 | 1 | 2:
                holder[key] = copy.deepcopy(rng.choice(VALUES))
            case 3 if type(holder[key]) is int:
                holder[key] += rng.choice((-1, 1, -holder[key] * 2, 1 << rng.randrange(40)))
            case 3 | 4:
                del holder[key]
            case 5:
                other, name = rng.choice(places)
                if key in (holder if isinstance(holder, dict) else range(len(holder))):
                    other[name] = copy.deepcopy(holder[key])
            case 6 if isinstance(holder, list):
                holder[key:key] = copy.deepcopy(holder[key : key + 3]) * rng.choice((1, 1, 30))
            case _:
                if isinstance(holder, dict):
                    holder[rng.choice(("", "x", "\x1b[2J", "links", "a" * 200, "\ud800"))] = copy.deepcopy(
                        rng.choice(VALUES)
                    )
    return data


def _places(data: Any, depth: int = 0) -> list[tuple[Any, Any]]:
    keys = list(data) if isinstance(data, dict) else list(range(len(data))) if isinstance(data, list) else []
    places = [(data, key) for key in keys]
    for key in keys if depth < 8 else ():
        places += _places(data[key], depth + 1)
    return places


def mutate_pickle(content: bytes, rng: random.Random) -> bytes:
    """A pickle with one to four of its operations left out, doubled, exchanged, or others put in between."""
    operations = _operations(content)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(operations) + 1)
        match rng.randrange(5):
            case 0:
                del operations[at : at + rng.choice((1, 1, 3))]
            case 1:
                operations[at:at] = operations[at : at + rng.choice((1, 3, 10))] * rng.choice((1, 1, 40))
            case 2 if len(operations) > 1:
                a, b = rng.sample(range(len(operations)), 2)
                operations[a], operations[b] = operations[b], operations[a]
            case 3:
                operations.insert(at, rng.choice(_GLOBALS))
            case _:
                operations.insert(at, rng.choice(OPCODES) + rng.randbytes(rng.choice((0, 0, 1, 4, 8))))
    return b"".join(operations)


def _operations(content: bytes) -> list[bytes]:
    starts = []
    try:
        starts = [position or 0 for _, _, position in pickletools.genops(content)]
    except Exception:  # what has been damaged before ends somewhere
        starts = starts or [0]
    return [content[start:end] for start, end in zip(starts, [*starts[1:], len(content)], strict=True)]


def mutate_champion(seeds: list[Any], rng: random.Random) -> bytes:
    """The bytes of a champion file, of either form, made from the plain data of one of the seeds and changed in one or two ways."""
    data = rng.choice(seeds)
    plain = mutate_plain(data, rng) if rng.random() < 0.7 else data
    if rng.random() < 0.5:
        content = json.dumps(plain, indent=rng.choice((None, 1))).encode("utf-8", "surrogatepass")
        return mutate_bytes(content, rng) if plain is data or rng.random() < 0.15 else content
    content = _dumped(plain, rng.choice((0, 1, 2, 3, 4, 4, 4, 5)))
    if plain is data or rng.random() < 0.15:
        content = rng.choice((mutate_pickle, mutate_bytes))(content, rng)
    return content


def _dumped(plain: Any, protocol: int) -> bytes:
    return pickle.dumps(plain, protocol=protocol)


def mutate_config(seeds: list[str], rng: random.Random) -> bytes:
    """The bytes of a configuration, made from one of the seeds: lines changed, then sometimes bytes."""
    lines = rng.choice(seeds).splitlines()
    for _ in range(rng.randint(0, 4)):
        at = rng.randrange(len(lines) + 1)
        match rng.randrange(6):
            case 0:
                lines.insert(at, rng.choice(LINES))
            case 1:
                del lines[at : at + 1]
            case 2:
                lines[at:at] = lines[at : at + 3]
            case 3 | 4 if at < len(lines):
                key, sign, value = lines[at].partition("=")
                words = (*map(str, VALUES[:-9]), *value.split(), "1 2", "none", "auto", "any", "clamped hat", "-1e999")
                lines[at] = key + (sign or "=") + " " + rng.choice(words)
            case _ if at < len(lines):
                other = rng.randrange(len(lines))
                lines[at], lines[other] = lines[other], lines[at]
            case _:
                lines.insert(at, rng.choice(rng.choice(seeds).splitlines()))
    content = "\n".join(lines).encode("utf-8", "surrogatepass")
    return mutate_bytes(content, rng) if rng.random() < 0.3 else content
