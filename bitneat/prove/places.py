# SPDX-License-Identifier: MIT
"""What the places of a C's state may keep: guesses, one of which a proof then has to confirm.

The generated C has a place for each signal that something reads a step later, or for what that can be computed from. Which place
is which is not taken from the generator, but from a simulation, and where that leaves a choice, from steps out of sampled states.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, permutations, product

import numpy as np

from bitneat.controller import Controller, Link, Signal
from bitneat.prove.evaluation import signed_values, values_of
from bitneat.prove.execute import Finished
from bitneat.prove.semantics import IntArray, Model
from bitneat.prove.terms import Atom, Term

_MOST_GUESSES = 400

Candidates = Sequence[Sequence[int]]
"""For each place of the state the signals that it was seen to keep, the likeliest first."""

Meaning = list[int | None]
"""Which signal each place keeps; None of one that keeps none."""


@dataclass
class Executed:
    """A step as terms: of the inputs and of what the state held."""

    finished: Finished
    outputs: list[Term]
    state: list[Term]
    """What the state holds after it."""
    slots: list[Atom]
    """What it held before."""


def seen_to_keep(model: Model, kept: IntArray, signals: IntArray) -> Candidates:
    """For each place of the state the signals that it was seen to keep, the likeliest first.

    They are guesses, one of which the proof then has to confirm: if it holds before a step, it holds after it. A place is there
    for a signal that something which an output needs reads with a delay; nobody keeps what never changes.
    """
    controller = model.controller
    delayed = {link.source for node in controller.nodes for link in node.links if link.delay}
    needed = _needed(controller)
    read = {link.source for i in needed for link in _links(controller, i) if link.delay}

    def unlikely(signal: int) -> tuple[bool, bool, bool]:
        return signal not in read, signal not in delayed, model.previous[signal].is_const

    order = sorted(range(controller.num_signals), key=unlikely) if model.previous else []
    return [
        [i for i in order if np.array_equal(kept[..., place], signals[..., i])]
        for place in range(kept.shape[-1] if kept.ndim == 3 else 0)
    ]


def _links(controller: Controller, signal: int) -> Sequence[Link]:
    first = len(controller.inputs)
    return () if signal < first else controller.nodes[signal - first].links


def _needed(controller: Controller) -> set[int]:
    """Signals that an output is made of, now or later."""
    needed: set[int] = set()
    new = [output.index for output in controller.outputs if isinstance(output, Signal)]
    while new:
        signal = new.pop()
        if signal not in needed:
            needed.add(signal)
            new += [link.source for link in _links(controller, signal)]
    return needed


def agreeing(
    executed: Executed,
    model: Model,
    samples: Mapping[Atom, IntArray],
    candidates: Candidates,
    tried: Sequence[Meaning],
) -> Meaning | None:
    """What places keep, so that steps from all sampled states give what the model says; the likeliest if nothing does.

    None if all that does was ``tried``.
    """
    guess = one_each(candidates)
    if not model.previous:
        return None if tried else guess
    count = len(next(iter(samples.values())))

    def numbers(terms: Sequence[Term], values: Mapping[Atom, IntArray]) -> list[IntArray]:
        return [np.broadcast_to(signed_values(one, 16), (count,)) for one in values_of(terms, values)]

    before, after = model.previous_values(samples, count), model.signal_values(samples, count)
    outputs: list[IntArray | None] = [*numbers(model.outputs, samples)]
    for meaning in islice(_guesses(candidates, guess), _MOST_GUESSES):
        if meaning in tried:
            continue
        kept = {atom: before[:, i] for atom, i in zip(executed.slots, meaning, strict=True) if i is not None}
        found = numbers([*executed.outputs, *executed.state], {**samples, **kept})
        wanted = outputs + [None if i is None else after[:, i] for i in meaning]
        if all(column is None or np.array_equal(one, column) for one, column in zip(found, wanted, strict=True)):
            return meaning
    return None if tried else guess


def _guesses(candidates: Candidates, likeliest: Meaning) -> Iterator[Meaning]:
    """All that places may keep, where those that seem to keep the same signals keep different ones."""
    yield likeliest
    groups: dict[tuple[int, ...], list[int]] = {}
    for place, found in enumerate(candidates):
        if len(found) > 1:
            groups.setdefault(tuple(found), []).append(place)
    ways = [permutations(found, min(len(places), len(found))) for found, places in groups.items()]
    for chosen in product(*ways):
        meaning = list(likeliest)
        for places, signals in zip(groups.values(), chosen, strict=True):
            for place, signal in zip(places, signals, strict=False):
                meaning[place] = signal
        yield meaning


def one_each(candidates: Candidates) -> Meaning:
    """Of places that seem to keep the same signals each keeps one of the likeliest, in their order if that can be."""
    places = Counter(map(tuple, candidates))
    unused = {found: sorted(found[:count]) for found, count in places.items()}
    guess: Meaning = []
    last = -1
    for found in map(tuple, candidates):
        if not found:
            guess.append(None)
            continue
        left = unused[found] or [found[0]]
        last = next((signal for signal in left if signal > last), left[0])
        guess.append(last)
        left.remove(last)
    return guess
