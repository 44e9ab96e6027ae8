# SPDX-License-Identifier: MIT
"""Small random changes of a controller, for a search that starts from one instead of from a population.

A genome of neat-python carries the history of its genes, which crossover needs; here there is only a controller, imported or
evolved, and whatever `vary` gives back is one again.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass

from bitneat.controller import Controller, ControllerError, Link, Node, Signal
from bitneat.controller.ir import GAIN_RANGE, SHIFT_RANGE, Constant

ACTIVATIONS = ("clamped", "hat", "step", "abs", "relu", "identity")
"""Those that cost no table; the smooth ones stay where a controller has them."""

_NEW_GAINS = (-4, 2)
"""Of a new node: where all weights are ±1, a small gain is what makes a small correction."""

_ATTEMPTS = 20


@dataclass
class _Draft:
    """A controller taken apart: sources below ``num_inputs`` are inputs, the others nodes in evaluation order."""

    controller: Controller
    nodes: list[_DraftNode]
    outputs: list[Signal | Constant]

    @property
    def num_inputs(self) -> int:
        return len(self.controller.inputs)


@dataclass
class _DraftNode:
    links: dict[tuple[int, int, int], int]
    """Sign by (source, delay, shift)."""
    bias: int
    gain: int
    activation: str


def vary(controller: Controller, rng: random.Random, mean_changes: float = 1.7) -> Controller:
    """A controller that differs from the given one, in canonical form.

    A geometrically distributed number of changes, ``mean_changes`` on average: links that come, go, flip, or read something else;
    gains; biases; activations; nodes that come, go, or are bypassed; outputs that read another node. Ternary controllers give
    ternary ones, and what reads no delayed value never will.
    """
    for _ in range(_ATTEMPTS):
        draft = _take_apart(controller)
        changes = 1 + int(math.log(1.0 - rng.random()) / math.log(1.0 - 1.0 / mean_changes)) if mean_changes > 1 else 1
        for _ in range(changes):
            rng.choices(_CHANGES, _WEIGHTS)[0](draft, rng)
        try:
            result = _put_together(draft).canonical
        except ControllerError:  # a sum that could leave the accumulator, most often
            continue
        if result.sha256 != controller.sha256 and (result.is_ternary or not controller.is_ternary):
            return result
    return controller


def _take_apart(controller: Controller) -> _Draft:
    nodes = [
        _DraftNode(
            {(link.source, link.delay, link.shift): link.sign for link in node.links},
            node.bias,
            node.gain,
            node.activation,
        )
        for node in controller.nodes
    ]
    return _Draft(controller, nodes, list(controller.outputs))


def _put_together(draft: _Draft) -> Controller:
    nodes = tuple(
        Node(tuple(sorted(Link(*key, sign) for key, sign in node.links.items())), node.bias, node.gain, node.activation)
        for node in draft.nodes
    )
    return Controller(draft.controller.inputs, nodes, tuple(draft.outputs), draft.controller.frac_bits)


def _some_node(draft: _Draft, rng: random.Random) -> int | None:
    return rng.randrange(len(draft.nodes)) if draft.nodes else None


def _some_link(draft: _Draft, rng: random.Random) -> tuple[_DraftNode, int, tuple[int, int, int]] | None:
    """Any link, all with the same chance: its node, that node's index, and its key."""
    total = sum(len(node.links) for node in draft.nodes)
    if not total:
        return None
    number = rng.randrange(total)
    for index, node in enumerate(draft.nodes):
        if number < len(node.links):
            return node, index, list(node.links)[number]
        number -= len(node.links)
    return None


def _some_source(draft: _Draft, index: int, rng: random.Random) -> int:
    return rng.randrange(draft.num_inputs + index)


def _add_link(draft: _Draft, rng: random.Random) -> None:
    if (index := _some_node(draft, rng)) is not None:
        draft.nodes[index].links[_some_source(draft, index, rng), 0, 0] = rng.choice((-1, 1))


def _delete_link(draft: _Draft, rng: random.Random) -> None:
    if found := _some_link(draft, rng):
        node, _, key = found
        del node.links[key]


def _flip_link(draft: _Draft, rng: random.Random) -> None:
    if found := _some_link(draft, rng):
        node, _, key = found
        node.links[key] = -node.links[key]


def _rewire_link(draft: _Draft, rng: random.Random) -> None:
    if found := _some_link(draft, rng):
        node, index, key = found
        sign = node.links.pop(key)
        node.links[_some_source(draft, index, rng), 0, key[2]] = sign


def _move_link(draft: _Draft, rng: random.Random) -> None:
    """The same source into another node."""
    found = _some_link(draft, rng)
    if not found:
        return
    node, _, key = found
    source, delay, _ = key
    first = 0 if delay else max(0, source - draft.num_inputs + 1)  # a node reads only what comes before it, or the past
    target = rng.randrange(first, len(draft.nodes))
    draft.nodes[target].links[key] = node.links.pop(key)


def _shift_link(draft: _Draft, rng: random.Random) -> None:
    """Twice or half as strong; of no use to a ternary controller, whose links have no shift."""
    if not draft.controller.is_ternary and (found := _some_link(draft, rng)):
        node, _, (source, delay, shift) = found
        other = min(max(shift + rng.choice((-1, 1)), SHIFT_RANGE[0]), SHIFT_RANGE[1])
        node.links[source, delay, other] = node.links.pop((source, delay, shift))


def _change_gain(draft: _Draft, rng: random.Random) -> None:
    if (index := _some_node(draft, rng)) is not None:
        node = draft.nodes[index]
        node.gain = min(max(node.gain + rng.choice((-1, 1)), GAIN_RANGE[0]), GAIN_RANGE[1])


def _change_bias(draft: _Draft, rng: random.Random) -> None:
    """A link from a constant one comes, goes or flips."""
    if (index := _some_node(draft, rng)) is not None:
        node, one = draft.nodes[index], draft.controller.one
        node.bias += rng.choice((-one, one))
        if draft.controller.is_ternary:
            node.bias = min(max(node.bias, -one), one)


def _change_activation(draft: _Draft, rng: random.Random) -> None:
    if (index := _some_node(draft, rng)) is not None:
        draft.nodes[index].activation = rng.choice(ACTIVATIONS)


def _insert(draft: _Draft, at: int, node: _DraftNode) -> int:
    """Put a node before the one at ``at``, and give the number of its signal."""
    first = draft.num_inputs + at

    def moved(source: int) -> int:
        return source + 1 if source >= first else source

    for other in draft.nodes:
        other.links = {(moved(s), delay, shift): sign for (s, delay, shift), sign in other.links.items()}
    draft.outputs = [Signal(moved(o.index)) if isinstance(o, Signal) else o for o in draft.outputs]
    draft.nodes.insert(at, node)
    return first


def _remove(draft: _Draft, at: int, instead: int) -> None:
    """Take a node away; outputs that read it read the signal ``instead``, an earlier one."""
    gone = draft.num_inputs + at

    def moved(source: int) -> int:
        return source - 1 if source > gone else source

    draft.nodes.pop(at)
    for other in draft.nodes:
        other.links = {(moved(s), delay, shift): sign for (s, delay, shift), sign in other.links.items() if s != gone}
    draft.outputs = [
        Signal(moved(instead if o.index == gone else o.index)) if isinstance(o, Signal) else o for o in draft.outputs
    ]


def _add_node(draft: _Draft, rng: random.Random) -> None:
    """A node that reads one to three signals, before some other node, which reads it."""
    if (index := _some_node(draft, rng)) is None:
        return
    links = {(_some_source(draft, index, rng), 0, 0): rng.choice((-1, 1)) for _ in range(rng.randint(1, 3))}
    signal = _insert(draft, index, _DraftNode(links, 0, rng.randint(*_NEW_GAINS), rng.choice(ACTIVATIONS)))
    draft.nodes[rng.randrange(index + 1, len(draft.nodes))].links[signal, 0, 0] = rng.choice((-1, 1))


def _share_links(draft: _Draft, rng: random.Random) -> None:
    """What two nodes read in common is summed once, by a node of its own."""
    if len(draft.nodes) < 2:
        return
    first, second = sorted(rng.sample(range(len(draft.nodes)), 2))
    a, b = draft.nodes[first], draft.nodes[second]
    common = {key: sign for key, sign in a.links.items() if not key[1] and b.links.get(key) in (sign, -sign)}
    if len(common) < 2:
        return
    same = {key: sign for key, sign in common.items() if b.links[key] == sign}
    chosen, factor = max((same, 1), ({k: s for k, s in common.items() if k not in same}, -1), key=lambda c: len(c[0]))
    if len(chosen) < 2:
        return
    for key in chosen:
        del a.links[key], b.links[key]
    signal = _insert(draft, first, _DraftNode(dict(chosen), 0, 0, "identity"))
    a.links[signal, 0, 0] = 1
    b.links[signal, 0, 0] = factor


def _delete_node(draft: _Draft, rng: random.Random) -> None:
    """Its readers do without it."""
    if (index := _some_node(draft, rng)) is not None:
        _remove(draft, index, _some_source(draft, index, rng))


def _bypass_node(draft: _Draft, rng: random.Random) -> None:
    """Its readers read what it read."""
    if (index := _some_node(draft, rng)) is None:
        return
    signal, node = draft.num_inputs + index, draft.nodes[index]
    for other in draft.nodes[index + 1 :]:
        for (source, _, shift), sign in list(other.links.items()):
            if source == signal:
                for (inner, delay, inner_shift), inner_sign in node.links.items():
                    other.links.setdefault((inner, delay, min(shift + inner_shift, SHIFT_RANGE[1])), sign * inner_sign)
    _remove(draft, index, _some_source(draft, index, rng))


def _change_output(draft: _Draft, rng: random.Random) -> None:
    if draft.nodes:
        draft.outputs[rng.randrange(len(draft.outputs))] = Signal(
            draft.num_inputs + rng.randrange(len(draft.nodes)) if rng.random() < 0.8 else _some_source(draft, 0, rng)
        )


_Change = Callable[[_Draft, random.Random], None]
_TABLE: dict[_Change, float] = {
    _add_link: 4,
    _delete_link: 5,
    _flip_link: 2,
    _rewire_link: 4,
    _move_link: 1.5,
    _shift_link: 2,
    _change_gain: 4,
    _change_bias: 1,
    _change_activation: 1.5,
    _add_node: 1,
    _share_links: 0.7,
    _delete_node: 0.7,
    _bypass_node: 0.7,
    _change_output: 0.3,
}
_CHANGES, _WEIGHTS = list(_TABLE), list(_TABLE.values())
