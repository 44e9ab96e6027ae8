# SPDX-License-Identifier: MIT
"""A second implementation of docs/semantics.md, written from its text alone.

It takes a controller's plain data and shares nothing with bitneat; the section numbers are those of the document. Where it
and the reference differ, the document is wrong or unclear, or the reference is.
"""

from __future__ import annotations

import hashlib
import math
from fractions import Fraction
from typing import Any

NAMES = ["identity", "clamped", "relu", "abs", "hat", "step", "tanh", "sigmoid", "sin", "gauss"]


def clip(x: int, low: int, high: int) -> int:
    return max(low, min(high, x))


# 6. Activations


class Activations:
    """The ten integer functions for one F."""

    def __init__(self, frac_bits: int) -> None:
        self.frac_bits = frac_bits
        self.one = 2**frac_bits

    def constant(self, v: int, more_bits: int = 0) -> int:
        return math.floor(Fraction(v) * Fraction(2) ** (self.frac_bits + more_bits - 12))

    def identity(self, u: int) -> int:
        return u

    def clamped(self, u: int) -> int:
        return clip(u, -self.one, self.one)

    def relu(self, u: int) -> int:
        return max(u, 0)

    def abs(self, u: int) -> int:
        return abs(u)

    def hat(self, u: int) -> int:
        return max(0, self.one - abs(u))

    def step(self, u: int) -> int:
        return self.one if u > 0 else 0

    def tanh(self, u: int) -> int:
        a = abs(u)
        m = min(
            2 * a + a // 2,
            2 * a + a // 32 + self.constant(208),
            a + a // 4 + self.constant(1073),
            a // 2 + a // 16 + self.constant(2318),
            a // 8 + a // 64 + self.constant(3473),
            self.one,
        )
        return m if u >= 0 else -m

    def sigmoid(self, u: int) -> int:
        return (self.one + self.tanh(u)) // 2

    def sin(self, u: int) -> int:
        a = min(abs(u), self.constant(49152))
        phase = 815 * a
        half_turn = 2 ** (self.frac_bits + 9)
        half = phase % half_turn
        quarter = min(half, self.constant(8192, 8) - half)
        m = min(
            quarter + quarter // 2,
            quarter + quarter // 16 + self.constant(686, 8),
            quarter // 2 + quarter // 128 + self.constant(2195, 8),
            self.constant(4096, 8),
        )
        s = m // 256
        if (phase // half_turn) % 2 == 1:
            s = -s
        return s if u >= 0 else -s

    def gauss(self, u: int) -> int:
        a = abs(u)
        head = min(
            self.one,
            self.constant(4299) - (a + a // 16),
            self.constant(4751) + a // 4 - 2 * a,
        )
        return max(head, self.constant(3072) + a // 32 - a, self.constant(1233) - (a // 4 + a // 16), 0)

    def by_name(self, name: str, u: int) -> int:
        return int(getattr(self, name)(u))


# 2. A controller: defaults filled in


def complete(data: dict[str, Any]) -> dict[str, Any]:
    return {
        "frac_bits": data["frac_bits"],
        "inputs": [{"scale": 0, "limit": 32767} | entry for entry in data["inputs"]],
        "nodes": [
            {"activation": "clamped", "gain": 0, "bias": 0}
            | node
            | {"links": [{"shift": 0, "delay": 0} | link for link in node["links"]]}
            for node in data["nodes"]
        ],
        "outputs": data["outputs"],
    }


# 3. Validity


def is_valid(data: dict[str, Any]) -> bool:
    c = complete(data)
    number_of_inputs = len(c["inputs"])
    signals = number_of_inputs + len(c["nodes"])
    ok = 4 <= c["frac_bits"] <= 12 and number_of_inputs >= 1 and signals <= 16383 and 1 <= len(c["outputs"]) <= 1024
    ok = ok and all(-16 <= e["scale"] <= 15 and 1 <= e["limit"] <= 32767 for e in c["inputs"])
    for output in c["outputs"]:
        if "signal" in output:
            ok = ok and 0 <= output["signal"] < signals
        else:
            ok = ok and -32767 <= output["constant"] <= 32767
    if not ok:
        return False
    limits = [entry["limit"] for entry in c["inputs"]]
    for node in c["nodes"]:
        if node["activation"] not in NAMES:
            return False
        limits.append(32767 if node["activation"] in ("identity", "relu", "abs") else 2 ** c["frac_bits"])
    for j, node in enumerate(c["nodes"]):
        if not -7 <= node["gain"] <= 7 or not -2147483647 <= node["bias"] <= 2147483647:
            return False
        total = abs(node["bias"])
        seen = []
        for link in node["links"]:
            if link["sign"] not in (1, -1) or not 0 <= link["shift"] <= 7 or link["delay"] not in (0, 1):
                return False
            bound = signals if link["delay"] else number_of_inputs + j
            if not 0 <= link["source"] < bound:
                return False
            key = (link["source"], link["delay"], link["shift"])
            if key in seen:
                return False
            seen.append(key)
            total += limits[link["source"]] * 2 ** link["shift"]
        if total * 2 ** max(node["gain"], 0) > 2**31 - 1:
            return False
    return True


# 4. Encode


def encode(data: dict[str, Any], observation: list[float]) -> list[int]:
    c = complete(data)
    assert len(observation) == len(c["inputs"])
    result = []
    for value, entry in zip(observation, c["inputs"], strict=True):
        if math.isnan(value):
            raise ValueError("NaN")
        limit = entry["limit"]
        if math.isinf(value):
            result.append(limit if value > 0 else -limit)
            continue
        # The float64 product is exact unless it overflows, which is far beyond any limit.
        scaled = Fraction(value) * Fraction(2) ** (c["frac_bits"] + entry["scale"])
        below = math.floor(scaled)
        rest = scaled - below
        rounded = below + (1 if rest > Fraction(1, 2) or (rest == Fraction(1, 2) and below % 2 == 1) else 0)
        result.append(clip(rounded, -limit, limit))
    return result


# 5. One step


class Machine:
    """A controller with its state."""

    def __init__(self, data: dict[str, Any]) -> None:
        self.controller = complete(data)
        self.activations = Activations(data["frac_bits"])
        self.reset()

    def reset(self) -> None:
        self.state = dict.fromkeys(range(len(self.controller["inputs"]) + len(self.controller["nodes"])), 0)

    def step(self, inputs: list[int]) -> list[int]:
        now = dict(enumerate(inputs))
        for node in self.controller["nodes"]:
            acc = node["bias"]
            for link in node["links"]:
                value = self.state[link["source"]] if link["delay"] == 1 else now[link["source"]]
                acc += link["sign"] * value * 2 ** link["shift"]
            gain = node["gain"]
            scaled = acc * 2**gain if gain >= 0 else math.floor(Fraction(acc, 2**-gain))
            now[len(now)] = self.activations.by_name(node["activation"], clip(scaled, -32767, 32767))
        self.state = now
        return [now[o["signal"]] if "signal" in o else o["constant"] for o in self.controller["outputs"]]


# 7. Decode


def decode_box(outputs: list[int], frac_bits: int, low: list[float], high: list[float]) -> list[float]:
    actions = []
    for y, lowest, highest in zip(outputs, low, high, strict=True):
        a = min(1.0, max(-1.0, y / 2**frac_bits))
        actions.append(lowest + (a + 1.0) / 2.0 * (highest - lowest))
    return actions


def decode_discrete(outputs: list[int], start: int) -> int:
    best = 0
    for i, y in enumerate(outputs):
        if y > outputs[best]:
            best = i
    return start + best


# 8. Canonical form


def canonical(data: dict[str, Any]) -> dict[str, Any]:
    c = complete(data)
    first = len(c["inputs"])
    activations = Activations(c["frac_bits"])
    value_of: dict[int, int] = {}
    nodes: dict[int, dict[str, Any]] = {}
    for number, node in enumerate(c["nodes"], start=first):
        bias = node["bias"]
        links = []
        for link in node["links"]:
            if link["delay"] == 0 and link["source"] in value_of:
                bias += link["sign"] * value_of[link["source"]] * 2 ** link["shift"]
            else:
                links.append(link)
        if links:
            nodes[number] = node | {"bias": bias, "links": links}
        else:
            gain = node["gain"]
            scaled = bias * 2**gain if gain >= 0 else math.floor(Fraction(bias, 2**-gain))
            value = activations.by_name(node["activation"], clip(scaled, -32767, 32767))
            value_of[number] = value
            kind = "clamped" if abs(value) <= 2 ** c["frac_bits"] else "identity"
            nodes[number] = {"activation": kind, "gain": 0, "bias": value, "links": []}
    outputs = [{"constant": value_of[o["signal"]]} if o.get("signal") in value_of else o for o in c["outputs"]]

    needed: set[int] = set()
    more = {o["signal"] for o in outputs if "signal" in o}
    while more:
        needed |= more
        more = {link["source"] for n in needed if n >= first for link in nodes[n]["links"]} - needed
    kept = [number for number in nodes if number in needed]
    # Kahn's order, literally.
    placed: list[int] = []
    while len(placed) < len(kept):
        placed.append(
            min(
                n
                for n in kept
                if n not in placed
                and all(k["source"] < first or k["source"] in placed for k in nodes[n]["links"] if k["delay"] == 0)
            )
        )
    new_number = {i: i for i in range(first)} | {old: first + k for k, old in enumerate(placed)}
    result_nodes = []
    for old in placed:
        links = [link | {"source": new_number[link["source"]]} for link in nodes[old]["links"]]
        links.sort(key=lambda link: (link["source"], link["delay"], link["shift"]))
        result_nodes.append(nodes[old] | {"links": links})
    return {
        "frac_bits": c["frac_bits"],
        "inputs": c["inputs"],
        "nodes": result_nodes,
        "outputs": [{"signal": new_number[o["signal"]]} if "signal" in o else o for o in outputs],
    }


# 9. SHA-256


def fingerprint_text(data: dict[str, Any]) -> str:
    c = canonical(data)

    def listed(items: list[str]) -> str:
        return "[" + ",".join(items) + "]"

    def numbers(*values: int) -> str:
        return listed([str(value) for value in values])

    inputs = [numbers(e["scale"], e["limit"]) for e in c["inputs"]]
    nodes = [
        listed(
            [
                str(NAMES.index(node["activation"])),
                str(node["gain"]),
                str(node["bias"]),
                listed([numbers(k["source"], k["delay"], k["shift"], k["sign"]) for k in node["links"]]),
            ]
        )
        for node in c["nodes"]
    ]
    outputs = [numbers(0, o["signal"]) if "signal" in o else numbers(1, o["constant"]) for o in c["outputs"]]
    return listed(["1", str(c["frac_bits"]), listed(inputs), listed(nodes), listed(outputs)])


def fingerprint(data: dict[str, Any]) -> str:
    return hashlib.sha256(fingerprint_text(data).encode("ascii")).hexdigest()
