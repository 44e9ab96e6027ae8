# SPDX-License-Identifier: MIT
"""The proof of one function of one binary: executed on terms, compared with the emulator on samples, then for all inputs."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from bitneat.controller import Reference
from bitneat.controller.reference import evaluate_signals
from bitneat.prove.equivalence import Difference, Effort, Equivalence
from bitneat.prove.evaluation import signed_values, values_of
from bitneat.prove.execute import Machine, Program
from bitneat.prove.flags import UnsupportedError
from bitneat.prove.memory import Region, Violation
from bitneat.prove.places import Candidates, Executed, Meaning, agreeing, seen_to_keep
from bitneat.prove.queries import SolverDisagreementError, differ
from bitneat.prove.replay import Counterexample, search
from bitneat.prove.semantics import IntArray, Model, build, random_states
from bitneat.prove.subject import Subject
from bitneat.prove.terms import WORD, Atom, Term, Terms, cone
from bitneat.verify.implementation import ImplementationError
from bitneat.verify.targets.image import Image

Verdict = Literal["proved", "refuted", "not proved"]

_Way = Literal["plainly", "widely", "thoroughly"]

_WAYS: tuple[tuple[_Way, bool], ...] = (
    ("plainly", False),
    ("widely", False),
    ("thoroughly", False),
    ("plainly", True),
    ("widely", True),
)
"""How values are looked for, one after the other until all is shown; and whether a solver is asked about all that is left."""
_SAMPLES = 256
_LANES = 32
_ATTEMPTS = 4
"""With what places of a state may keep."""
_STEPS = 12
_RARE = 4
_SEED = 1


@dataclass
class FunctionProof:
    """What was found out about one function."""

    function: str
    verdict: Verdict = "not proved"
    reason: str = ""
    counterexample: Counterexample | None = None
    instructions: int = 0
    stack_bytes: int = 0
    effort: Effort = field(default_factory=Effort)
    seconds: float = 0.0
    meaning: Sequence[int | None] = ()
    """Which signal each place of the C's state keeps; None of one that keeps none."""

    def to_data(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "function": self.function,
            "verdict": self.verdict,
            "reason": self.reason or None,
            "counterexample": None if self.counterexample is None else self.counterexample.to_data(),
            "instructions": self.instructions,
            "stack_bytes": self.stack_bytes,
            "lemmas": {
                "exhaustive": self.effort.exhaustive,
                "solver": self.effort.solver,
                "known": self.effort.known,
            },
            "seconds": round(self.seconds, 2),
        }

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> FunctionProof:
        """Read what `to_data` of a function that was proved wrote.

        Raises:
            KeyError, TypeError, ValueError: if it is something else.
        """
        if data["verdict"] != "proved":
            raise ValueError("no proof")
        lemmas = data["lemmas"]
        return cls(
            str(data["function"]),
            "proved",
            instructions=int(data["instructions"]),
            stack_bytes=int(data["stack_bytes"]),
            effort=Effort(int(lemmas["exhaustive"]), int(lemmas["solver"]), int(lemmas["known"])),
            seconds=float(data["seconds"]),
        )


class _NotProved(Exception):  # noqa: N818 - one of the two ways that a proof ends
    """Carries the reason, and where there is one inputs and state to try."""

    def __init__(self, reason: str, attempt: tuple[Sequence[int], Sequence[int]] | None = None) -> None:
        super().__init__(reason)
        self.attempt = attempt


def prove_function(subject: Subject, function: str) -> FunctionProof:
    """Prove one function of a binary.

    Args:
        subject: the binary.
        function: ``step``, ``run``, ``reset`` or ``decide``.
    """
    proof = FunctionProof(f"{subject.image.code.name}_{function}")
    begin = time.perf_counter()
    attempt: tuple[Sequence[int], Sequence[int]] | None = None
    try:
        _PROVERS[function](subject, proof)
        proof.verdict = "proved"
    except (Violation, UnsupportedError, SolverDisagreementError) as found:
        proof.reason = str(found)
    except _NotProved as found:
        proof.reason, attempt = str(found), found.attempt
    if proof.verdict != "proved" and function in ("step", "run"):
        proof.counterexample = search(subject, proof.meaning, attempt)
        if proof.counterexample is not None:
            proof.verdict = "refuted"
    proof.seconds = time.perf_counter() - begin
    return proof


def _program(image: Image) -> Program:
    functions = {name: at for name, at in image.symbols.items() if name.startswith(f"{image.code.name}_")}
    return Program(image.code_range, image.controller, functions)


# A step --------------------------------------------------------------------------------------------------------------


def _execute(subject: Subject, terms: Terms, model: Model) -> Executed:
    image = subject.image
    code, symbols = image.code, image.symbols
    run = image.entry == "run"
    regions: list[Region] = []
    arguments: list[int] = []

    def region(symbol: str, name: str, count: int, *, writable: bool) -> range:
        place = range(symbols[symbol], symbols[symbol] + 2 * count)
        regions.append(Region(name, place, writable=writable))
        arguments.append(place.start)
        return place

    slots = [Atom(f"state[{i}]", -32768, 32767) for i in range(code.num_state or 0)]
    state = region("bitneat_state", "its state", len(slots), writable=True) if slots else range(0)
    if run:
        signals = region("bitneat_signals", "its signals", code.num_signals or 0, writable=True)
        at, to = signals.start, signals.stop - 2 * code.num_outputs
    else:
        observation = region("bitneat_observation", "the observation", code.num_inputs, writable=False)
        action = region("bitneat_action", "the action", code.num_outputs, writable=True)
        at, to = observation.start, action.start
    machine = Machine(terms, subject.processor, _program(image), regions)
    for i, atom in enumerate(model.inputs):
        machine.memory.provide(at + 2 * i, terms.var(atom, 16))
    for i, atom in enumerate(slots):
        machine.memory.provide(state.start + 2 * i, terms.var(atom, 16))
    finished = machine.call(image.function, arguments)
    return Executed(
        finished,
        [finished.memory.result(to + 2 * i, 2, f"output {i}") for i in range(code.num_outputs)],
        [finished.memory.result(state.start + 2 * i, 2, f"state {i}") for i in range(len(slots))],
        slots,
    )


def _prove_step(subject: Subject, proof: FunctionProof) -> None:
    code = subject.image.code
    if (code.num_inputs, code.num_outputs) != (len(subject.controller.inputs), len(subject.controller.outputs)):
        raise _NotProved("it has another number of inputs or outputs than the controller")
    terms = Terms()
    model = build(terms, subject.controller, guard=subject.guard)
    executed = _execute(subject, terms, model)
    made = list(terms.made)
    proof.instructions, proof.stack_bytes = executed.finished.instructions, executed.finished.stack_bytes
    generator = np.random.default_rng(_SEED)
    unknown = _unknown_atoms([*executed.outputs, *executed.state])
    candidates = _simulate(subject, model, executed, generator, unknown)
    samples = _samples(subject, model, generator)
    _check_reference(model, samples)
    samples |= {
        atom: generator.integers(atom.low, atom.high, _SAMPLES, endpoint=True) for atom in _others(made, samples)
    }

    failure: _NotProved | None = None
    tried: list[Meaning] = []
    while len(tried) < _ATTEMPTS:
        meaning = agreeing(executed, model, samples, candidates, tried)
        if meaning is None:
            break
        tried.append(meaning)
        found: tuple[str, Difference] | None = None
        settled: dict[_Way, tuple[Equivalence, Meaning]] = {}
        for way, whole in _WAYS:
            if way not in settled:
                settled[way] = _settled(subject, terms, model, made, executed, samples, candidates, meaning, way)
            equivalence, kept = settled[way]
            proof.effort, proof.meaning = equivalence.effort, kept
            found = _first_difference(equivalence, model, executed, kept, whole=whole)
            if found is None:
                return
            if found[1].model is not None:
                break
        assert found is not None
        what, difference = found
        failure = failure or _not_equal(what, model, candidates, difference.model)
        if difference.model is not None:
            # What the places keep may be a wrong guess, which then shows in this state, too.
            samples = _with_row(model, samples, difference.model, row=len(tried))
    assert failure is not None
    raise failure


def _settled(
    subject: Subject,
    terms: Terms,
    model: Model,
    made: Sequence[Term],
    executed: Executed,
    samples: Mapping[Atom, IntArray],
    candidates: Candidates,
    meaning: Meaning,
    way: _Way,
) -> tuple[Equivalence, Meaning]:
    """Find the cuts, with places of the state standing for what is shown to be kept in them, as far as that goes."""
    while True:
        places = dict(zip(executed.slots, meaning, strict=True))
        equivalence = _equivalence(subject, terms, model, samples, places, way)
        equivalence.abstract(made)
        better = [
            _kept(equivalence, model, term, found, now)
            for term, found, now in zip(executed.state, candidates, meaning, strict=True)
        ]
        candidates = [
            [one for one in found if one != now or one == new]  # what was wrong once is not tried again
            for found, now, new in zip(candidates, meaning, better, strict=True)
        ]
        if better == meaning:
            return equivalence, meaning
        meaning = better


def _first_difference(
    equivalence: Equivalence, model: Model, executed: Executed, meaning: Meaning, *, whole: bool
) -> tuple[str, Difference] | None:
    """The first output or place of the state that is not shown to be right, by its name."""
    claims = [(f"output {i}", *pair) for i, pair in enumerate(zip(executed.outputs, model.outputs, strict=True))]
    claims += [
        (f"state {i}", term, model.signals[signal])
        for i, (term, signal) in enumerate(zip(executed.state, meaning, strict=True))
        if signal is not None
    ]
    for what, term, expected in claims:
        difference = equivalence.difference(term, expected, whole=whole)
        if difference is not None:
            return what, difference
    return None


def _with_row(
    model: Model, samples: Mapping[Atom, IntArray], found: Mapping[Atom, int], row: int
) -> dict[Atom, IntArray]:
    """The samples with one of them replaced: by what a solver found."""
    inputs = np.array([[found.get(atom, 0) for atom in model.inputs]], dtype=np.int64)
    state = np.array([[found.get(atom, 0) for atom in model.free]], dtype=np.int64)
    values = {atom: int(column[0]) for atom, column in model.samples(inputs, state).items()}
    changed = {}
    for atom, column in samples.items():
        changed[atom] = column.copy()
        changed[atom][row] = values.get(atom, found.get(atom, 0))
    return changed


def _others(made: Sequence[Term], samples: Mapping[Atom, IntArray]) -> dict[Atom, None]:
    """Atoms that the model does not have: what nobody initialised, and the state."""
    return {one.atom: None for one in made if one.atom is not None and one.atom not in samples}


def _equivalence(
    subject: Subject,
    terms: Terms,
    model: Model,
    samples: Mapping[Atom, IntArray],
    meaning: Mapping[Atom, int | None],
    way: _Way,
) -> Equivalence:
    """With the state's places standing for signals; those without a meaning stay unknown."""
    kept = {atom: signal for atom, signal in meaning.items() if signal is not None}
    values = dict(samples)
    if kept:
        before = model.previous_values(samples, _SAMPLES)
        values |= {atom: before[:, signal] for atom, signal in kept.items()}
    state = {atom: model.previous[signal] for atom, signal in kept.items()}
    return Equivalence(
        terms,
        model,
        values,
        state,
        subject.lemmas,
        widely=way == "widely",
        thoroughly=way == "thoroughly",
        paranoid=subject.paranoid,
    )


def _kept(equivalence: Equivalence, model: Model, term: Term, candidates: Sequence[int], now: int | None) -> int | None:
    """Which of the signals that a place of the state seemed to keep it does keep, as far as has been shown."""
    if now is None or equivalence.is_shown(term, model.signals[now]):
        return now
    return next((one for one in candidates if equivalence.is_shown(term, model.signals[one])), now)


def _not_equal(what: str, model: Model, candidates: Candidates, found: Mapping[Atom, int] | None) -> _NotProved:
    if found is None:
        return _NotProved(f"{what}: not shown to be equal")
    if any(atom.undefined for atom in found):
        what += " may depend on what registers or the stack held before"
    inputs = np.array([[found.get(atom, 0) for atom in model.inputs]], dtype=np.int64)
    state = np.array([[found.get(atom, 0) for atom in model.free]], dtype=np.int64)
    previous: list[int] = []
    if model.previous:
        previous = model.previous_values(model.samples(inputs, state), 1)[0].tolist()
        if any(len({previous[signal] for signal in signals}) > 1 for signals in candidates):
            # Which of them a place keeps is a guess, and a state by a wrong guess would refute what is right.
            return _NotProved(f"{what}: can differ, if the state keeps what it seems to")
    return _NotProved(f"{what}: can differ", (inputs[0].tolist(), previous))


def _samples(subject: Subject, model: Model, generator: np.random.Generator) -> dict[Atom, IntArray]:
    """Values of the model's atoms, of which each is to change at least a few times: (samples,) each."""
    count = 16 * _SAMPLES
    inputs = subject.inputs(count, _SEED + 1)
    free = random_states(model, generator, count)
    values = model.samples(inputs, free)
    chosen = list(range(_SAMPLES // 2))
    for cut in model.cuts:
        assert cut.value.atom is not None
        column = values[cut.value.atom]
        if len(set(column[chosen].tolist())) < _RARE:
            _, first = np.unique(column, return_index=True)
            chosen += first[generator.permutation(len(first))[:_RARE]].tolist()
    rows = np.array([*chosen, *range(_SAMPLES // 2, count)][:_SAMPLES])
    return model.samples(inputs[rows], free[rows])


def _check_reference(model: Model, samples: Mapping[Atom, IntArray]) -> None:
    """The model is the reference: where it was evaluated, at the least."""
    controller = model.controller
    signals = model.signal_values(samples, _SAMPLES)
    before = model.previous_values(samples, _SAMPLES) if model.previous else np.zeros_like(signals)
    for row in range(0, _SAMPLES, 8):
        expected = evaluate_signals(controller, signals[row, : len(controller.inputs)].tolist(), before[row].tolist())
        if signals[row].tolist() != expected:
            raise AssertionError("the terms of the controller do not give the reference's values")


def _unknown_atoms(roots: Sequence[Term]) -> list[Atom]:
    return list(dict.fromkeys(one.atom for one in cone(roots) if one.atom is not None and one.atom.undefined))


def _simulate(
    subject: Subject, model: Model, executed: Executed, generator: np.random.Generator, unknown: Sequence[Atom]
) -> Candidates:
    """Take steps from reset in terms, in the reference and in the emulator; which signals each place of the state may keep.

    Raises:
        _NotProved: with the inputs, if they do not agree.
    """
    controller = subject.controller
    steps, lanes = (_STEPS, _LANES) if executed.slots else (1, _SAMPLES)
    inputs = subject.inputs(steps * lanes, _SEED).reshape(steps, lanes, -1)
    state = np.zeros((lanes, len(executed.slots)), dtype=np.int64)
    references = [Reference(controller) for _ in range(lanes)]
    found = np.zeros((steps, lanes, len(executed.outputs)), dtype=np.int64)
    kept, signals = [], []
    wrong: list[int] = []
    for step in range(steps):
        values = dict(zip(model.inputs, inputs[step].T, strict=True)) | dict(zip(executed.slots, state.T, strict=True))
        values |= {atom: generator.integers(atom.low, atom.high, lanes, endpoint=True) for atom in unknown}
        results = [
            np.broadcast_to(signed_values(one, 16), (lanes,))
            for one in values_of([*executed.outputs, *executed.state], values)
        ]
        found[step] = np.stack(results[: len(executed.outputs)], axis=1)
        if executed.slots:
            state = np.stack(results[len(executed.outputs) :], axis=1)
        limits = np.array([entry.limit for entry in controller.inputs])
        clipped = np.clip(inputs[step], -limits, limits)
        for lane, reference in enumerate(references):
            if found[step, lane].tolist() != reference.step(clipped[lane].tolist()):
                wrong.append(step + 1)
        kept.append(state)
        signals.append(np.array([reference.signals for reference in references], dtype=np.int64))
    _check_emulator(subject, inputs, found)
    if wrong:
        raise _NotProved(f"it gives other outputs in step {wrong[0]} from reset")
    return seen_to_keep(model, np.array(kept), np.array(signals))


def _check_emulator(subject: Subject, inputs: IntArray, found: IntArray) -> None:
    """What the lifter says that instructions do, against an emulator that knows nothing of it."""
    emulated = subject.emulated
    lanes = inputs.shape[1]
    for lane in range(lanes if subject.image.code.num_state else 1):
        rows = inputs[:, lane] if subject.image.code.num_state else inputs[0]
        emulated.reset()
        try:
            ran = emulated.run(rows.astype(np.int16))
        except ImplementationError as error:
            emulated.restart()
            raise _NotProved(f"in the emulator it {error}") from None
        terms = found[:, lane] if subject.image.code.num_state else found[0]
        if not np.array_equal(ran, terms):
            raise _NotProved(
                "the emulator computes something else than the lifted instructions, or what was never set shows"
            )


# Reset and choice ----------------------------------------------------------------------------------------------------


def _prove_reset(subject: Subject, proof: FunctionProof) -> None:
    image, terms = subject.image, Terms()
    count = image.code.num_state or 0
    place = range(image.symbols["bitneat_state"], image.symbols["bitneat_state"] + 2 * count)
    region = Region("its state", place, writable=True)
    finished = Machine(terms, subject.processor, _program(image), [region]).call(proof.function, [place.start])
    proof.instructions, proof.stack_bytes = finished.instructions, finished.stack_bytes
    for i in range(count):
        if finished.memory.result(place.start + 2 * i, 2, f"state {i}") is not terms.const(16, 0):
            raise _NotProved(f"state {i} is not 0 after a reset")


def _prove_decide(subject: Subject, proof: FunctionProof) -> None:
    image, terms = subject.image, Terms()
    count = image.code.num_outputs
    place = range(image.symbols["bitneat_action"], image.symbols["bitneat_action"] + 2 * count)
    region = Region("the action", place, writable=False)
    machine = Machine(terms, subject.processor, _program(image), [region])
    atoms = [Atom(f"action[{i}]", -32767, 32767) for i in range(count)]
    for i, atom in enumerate(atoms):
        machine.memory.provide(place.start + 2 * i, terms.var(atom, 16))
    finished = machine.call(proof.function, [place.start])
    proof.instructions, proof.stack_bytes = finished.instructions, finished.stack_bytes
    best, chosen = terms.var(atoms[0], WORD), terms.const(WORD, subject.start)
    for i, atom in enumerate(atoms[1:], start=1):
        value = terms.var(atom, WORD)
        larger = terms.slt(best, value)
        best, chosen = terms.ite(larger, value, best), terms.ite(larger, terms.const(WORD, subject.start + i), chosen)
    found = terms.extract(finished.returned, 0, WORD)
    _check_choices(subject, found, atoms)
    answer = differ(found, chosen, seconds=60, paranoid=subject.paranoid)
    if answer.outcome != "equal":
        raise _NotProved("the choice: not shown to be the index of the largest output, the lowest of equals")
    proof.effort.solver += 1


def _check_choices(subject: Subject, found: Term, atoms: Sequence[Atom]) -> None:
    """As `_check_emulator`."""
    generator = np.random.default_rng(_SEED)
    outputs = generator.integers(-32767, 32767, size=(_SAMPLES, len(atoms)), endpoint=True)
    outputs[::4] = outputs[::4] >> 14  # few values, so that some are equal
    values = dict(zip(atoms, outputs.T, strict=True))
    values |= {atom: np.zeros(_SAMPLES, dtype=np.int64) for atom in _unknown_atoms([found])}
    lifted = np.broadcast_to(signed_values(values_of([found], values)[0], WORD), (_SAMPLES,))
    if not np.array_equal(subject.emulated.decisions(outputs.astype(np.int16))[:, 0], lifted):
        raise _NotProved(
            "the emulator computes something else than the lifted instructions, or what was never set shows"
        )


_PROVERS = {"step": _prove_step, "run": _prove_step, "reset": _prove_reset, "decide": _prove_decide}
