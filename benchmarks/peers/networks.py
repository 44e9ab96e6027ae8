# SPDX-License-Identifier: MIT
"""The networks that every generator gets: netb, a dense one, and the committed champions that have no state."""

from __future__ import annotations

import json
import random
from pathlib import Path

from bitneat import champion as champions
from bitneat.controller import Controller, Input, Link, Node, Signal

ROOT = Path(__file__).parents[2]
INPUT_LIMIT = 2047
DENSE = (24, 16, 4)
DENSE_SEED = 24164


def networks() -> dict[str, Controller]:
    """Every network by the name that the table gives it."""
    return {
        "netb": netb(),
        "dense 24-16-4": dense(),
        "tiny champion": champions.load(ROOT / "examples" / "champions" / "tiny.pkl").controller.canonical,
        "walker champion": champions.load(ROOT / "examples" / "champions" / "walker.pkl").controller.canonical,
    }


def netb() -> Controller:
    """The sparse ternary network of benchmarks/netb.json: a clamp on every node, no bias."""
    data = json.loads((ROOT / "benchmarks" / "netb.json").read_text(encoding="utf-8"))
    first, count, outputs = data["num_inputs"], data["num_nodes"], data["num_outputs"]
    links: dict[int, list[Link]] = {node: [] for node in range(first, first + count)}
    for source, node, sign in data["links"]:
        links[node].append(Link(source, sign=sign))
    return Controller(
        tuple(Input(0, data["input_limit"]) for _ in range(first)),
        tuple(Node(tuple(sorted(links[node]))) for node in range(first, first + count)),
        tuple(Signal(first + count - outputs + index) for index in range(outputs)),
        data["frac_bits"],
    )


def dense() -> Controller:
    """Two layers in which every weight is +1 or -1: what generators for dense networks are made for."""
    rng = random.Random(DENSE_SEED)
    num_inputs, num_hidden, num_outputs = DENSE
    hidden = tuple(
        Node(tuple(Link(source, sign=rng.choice((1, -1))) for source in range(num_inputs))) for _ in range(num_hidden)
    )
    outputs = tuple(
        Node(tuple(Link(num_inputs + source, sign=rng.choice((1, -1))) for source in range(num_hidden)))
        for _ in range(num_outputs)
    )
    first = num_inputs + num_hidden
    return Controller(
        tuple(Input(0, INPUT_LIMIT) for _ in range(num_inputs)),
        hidden + outputs,
        tuple(Signal(first + index) for index in range(num_outputs)),
    )


def levels(controller: Controller) -> list[list[int]]:
    """The nodes' signals by depth: each level needs inputs and earlier levels only."""
    depth = [0] * len(controller.inputs)
    for node in controller.nodes:
        depth.append(1 + max((depth[link.source] for link in node.links), default=0))
    result: list[list[int]] = [[] for _ in range(max(depth))]
    for signal in range(len(controller.inputs), len(depth)):
        result[depth[signal] - 1].append(signal)
    return result
