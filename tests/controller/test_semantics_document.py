# SPDX-License-Identifier: MIT
"""docs/semantics.md says what the code does: its tables, its known answers, and an implementation written from its text."""

from __future__ import annotations

import json
import math
import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from bitneat.controller import (
    ACTIVATION_NAMES,
    BoxAction,
    Controller,
    ControllerError,
    DiscreteAction,
    Encoder,
    Reference,
)
from bitneat.controller.activation import ACTIVATION_CODES, PROGRAMS, Op, Program, Step, evaluate, real_function, table
from tests.controller import second_implementation as second
from tests.strategies import controllers, controllers_with_inputs, input_vectors, patient, random_controller

DOCUMENT = (Path(__file__).parents[2] / "docs" / "semantics.md").read_text(encoding="utf-8")
FRAC_BITS = range(4, 13)


def fenced(mark: str) -> str:
    """The code block that follows a mark in the document."""
    found = re.search(rf"<!-- {mark} -->\n```\w+\n(.*?)```", DOCUMENT, re.DOTALL)
    assert found, f"docs/semantics.md: no block is marked {mark!r}"
    return found[1].strip()


def rows(mark: str) -> Iterator[list[str]]:
    """The rows of the table that follows a mark, without its heading."""
    found = re.search(rf"<!-- {mark} -->\n((?:\|.*\n)+)", DOCUMENT)
    assert found, f"docs/semantics.md: no table is marked {mark!r}"
    for line in found[1].splitlines()[2:]:
        yield [cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def parsed(text: str) -> tuple[Step, ...]:
    """Read a program in the notation of the document."""
    patterns: list[tuple[str, Any]] = [
        (r"C(\d*)\((\d+)\)", lambda k, v: Step(Op.CONST, k=int(k or 0), value=int(v))),
        (r"(\d+)", lambda v: Step(Op.INT, value=int(v))),
        (r"t(\d+) \+ t(\d+)", lambda x, y: Step(Op.ADD, int(x), int(y))),
        (r"t(\d+) - t(\d+)", lambda x, y: Step(Op.SUB, int(x), int(y))),
        (r"t(\d+) << (\d+)", lambda x, k: Step(Op.SHL, int(x), k=int(k))),
        (r"t(\d+) >> (\d+)", lambda x, k: Step(Op.SHR, int(x), k=int(k))),
        (r"t(\d+) << F", lambda x: Step(Op.SHL_F, int(x))),
        (r"low(\d+)\(t(\d+)\)", lambda k, x: Step(Op.LOW, int(x), k=int(k))),
        (r"bit(\d+)\(t(\d+)\)", lambda k, x: Step(Op.BIT, int(x), k=int(k))),
        (r"min\(t(\d+), t(\d+)\)", lambda x, y: Step(Op.MIN, int(x), int(y))),
        (r"max\(t(\d+), t(\d+)\)", lambda x, y: Step(Op.MAX, int(x), int(y))),
        (r"copysign\(t(\d+), t(\d+)\)", lambda x, y: Step(Op.COPYSIGN, int(x), int(y))),
    ]
    steps: list[Step] = []
    for number, statement in enumerate(filter(None, (part.strip() for part in text.split(";"))), start=1):
        name, _, expression = statement.partition(" = ")
        assert name == f"t{number}"
        (step,) = (make(*m.groups()) for pattern, make in patterns if (m := re.fullmatch(pattern, expression)))
        steps.append(step)
    return tuple(steps)


class TestTheTextIsTheCode:
    @pytest.mark.parametrize("name", ACTIVATION_NAMES)
    def test_programs(self, name: str) -> None:
        assert parsed(fenced(f"program: {name}")) == PROGRAMS[name].steps

    def test_programs_written_there_compute_the_activations(self) -> None:
        """The notation is read back into a program, so a listing that says something else computes something else."""
        arguments = np.arange(-32767, 32768, dtype=np.int64)
        for name in ACTIVATION_NAMES:
            program = Program(name, "", parsed(fenced(f"program: {name}")))
            for frac_bits in FRAC_BITS:
                assert (program(arguments, frac_bits) == table(name, frac_bits)).all()

    def test_names_and_codes(self) -> None:
        listed = dict(re.findall(r"^\| (\d) \| `(\w+)` \|", DOCUMENT, re.MULTILINE))
        assert {name: int(code) for code, name in listed.items()} == ACTIVATION_CODES

    def test_errors(self) -> None:
        arguments = np.arange(-32767, 32768, dtype=np.int64)
        for label, *cells in rows("errors"):
            name, _, condition = label.partition(", ")
            for frac_bits, cell in zip(FRAC_BITS, cells, strict=True):
                z = arguments / 2**frac_bits
                error = np.abs(table(name, frac_bits) / 2**frac_bits - real_function(name, z))
                if condition:
                    assert condition == "|z| ≤ 4"
                    error = error[np.abs(z) <= 4]
                assert cell == f"{math.ceil(error.max() * 1000) / 1000:.3f}", f"{label} at F = {frac_bits}"

    def test_known_activations(self) -> None:
        count = 0
        for u, *values in rows("known"):
            assert [int(value) for value in values] == [evaluate(name, int(u), 8) for name in ACTIVATION_NAMES]
            count += 1
        assert count == 15

    def test_known_steps_and_fingerprint(self) -> None:
        data = json.loads(fenced("example"))
        controller = Controller.from_data(data)
        reference = Reference(controller)
        machine = second.Machine(data)
        for _, inputs, outputs in rows("steps"):
            vector = [int(x) for x in inputs.split()]
            assert reference.step(vector) == machine.step(vector) == [int(y) for y in outputs.split()]
        assert second.fingerprint_text(data) == fenced("text")
        assert controller.sha256 == second.fingerprint(data) == fenced("sha256")

    def test_ranges_of_fields(self) -> None:
        """The table of section 3 is turned into controllers at the edge and just beyond."""
        good = {
            "frac_bits": 4,
            "inputs": [{}],
            "nodes": [{"links": [{"source": 0, "sign": 1}]}],
            "outputs": [{"signal": 1}],
        }
        places: dict[str, list[Any]] = {
            "frac_bits": ["frac_bits"],
            "scale": ["inputs", 0, "scale"],
            "limit": ["inputs", 0, "limit"],
            "gain": ["nodes", 0, "gain"],
            "bias": ["nodes", 0, "bias"],
            "shift": ["nodes", 0, "links", 0, "shift"],
        }
        ranges = re.findall(r"^\| `(\w+)` \| (-?\d+) to (-?\d+) \|$", DOCUMENT, re.MULTILINE)
        assert {name for name, _, _ in ranges} >= set(places)
        for name, low, high in ranges:
            for value, valid in ((int(low), True), (int(high), True), (int(low) - 1, False), (int(high) + 1, False)):
                if name not in places:
                    continue
                data = json.loads(json.dumps(good))
                place = data
                for key in places[name][:-1]:
                    place = place[key]
                place[places[name][-1]] = value
                if name == "bias":  # so that the accumulator rule is no obstacle
                    data["nodes"][0]["links"] = []
                assert second.is_valid(data) == valid, (name, value)
                if valid:
                    Controller.from_data(data)
                else:
                    with pytest.raises(ControllerError, match=name):
                        Controller.from_data(data)


class TestAnImplementationFromTheText:
    @pytest.mark.parametrize("block", range(10))
    def test_gives_every_output_bit_of_seeded_controllers(self, block: int, budget: int) -> None:
        for seed in range(block, 400 * budget, 10):
            rng = random.Random(seed)
            controller = random_controller(rng)
            sequence = input_vectors(controller, rng, 25)
            machine = second.Machine(controller.to_data())
            got = [machine.step(inputs) for inputs in sequence]
            assert got == Reference(controller).run(sequence), f"seed {seed}"

    @patient
    @given(controllers_with_inputs())
    def test_gives_every_output_bit(self, case: tuple[Controller, list[list[int]]]) -> None:
        controller, sequence = case
        machine = second.Machine(controller.to_data())
        assert [machine.step(inputs) for inputs in sequence] == Reference(controller).run(sequence)

    @pytest.mark.parametrize("frac_bits", FRAC_BITS)
    def test_gives_the_same_activations(self, frac_bits: int) -> None:
        activations = second.Activations(frac_bits)
        one = 1 << frac_bits
        near = range(-3 * one, 3 * one, max(1, one // 100))
        for u in {*range(-32767, 32768, 251), *range(-40, 41), *near, one, -one, 32767}:
            if abs(u) <= 32767:
                for name in ACTIVATION_NAMES:
                    assert activations.by_name(name, u) == evaluate(name, u, frac_bits), (name, u)

    @patient
    @given(controllers())
    def test_gives_the_same_canonical_form_and_fingerprint(self, controller: Controller) -> None:
        assert second.canonical(controller.to_data()) == controller.canonical.to_data()
        assert second.fingerprint(controller.to_data()) == controller.sha256

    def test_gives_the_same_fingerprints_of_seeded_controllers(self) -> None:
        for seed in range(100):
            controller = random_controller(random.Random(seed), size="small" if seed % 4 else "medium")
            assert second.fingerprint(controller.to_data()) == controller.sha256, f"seed {seed}"

    def test_accepts_and_refuses_the_same_controllers(self) -> None:
        """Valid controllers with one number changed to another: both say the same about each."""
        counts = {True: 0, False: 0}
        for seed in range(1500):
            rng = random.Random(seed)
            data = random_controller(rng, size="small").to_data()
            places = list(_numbers(data))
            container, key = rng.choice(places)
            container[key] = rng.choice(
                (container[key] + rng.choice((-1, 1)), -container[key], 0, 8, 13, 32768, -(2**31), 2**31 - 1, 2**30)
            )
            valid = second.is_valid(data)
            counts[valid] += 1
            if valid:
                Controller.from_data(data)
            else:
                with pytest.raises(ControllerError):
                    Controller.from_data(data)
        assert min(counts.values()) > 300

    def test_encodes_the_same(self) -> None:
        for seed in range(300):
            rng = random.Random(seed)
            controller = random_controller(rng, size="small", num_nodes=0)
            values = [
                rng.choice(
                    (rng.gauss(0, 1), rng.gauss(0, 1e4), math.inf, -math.inf, rng.randint(-99, 99) / 512, 0.5, 1e300)
                )
                for _ in controller.inputs
            ]
            assert Encoder(controller)(values).tolist() == second.encode(controller.to_data(), values), f"seed {seed}"

    def test_decodes_the_same(self) -> None:
        for seed in range(300):
            rng = random.Random(seed)
            frac_bits = rng.randint(4, 12)
            outputs = [
                rng.choice((0, 1 << frac_bits, rng.randint(-32767, 32767), rng.randint(-40, 40))) for _ in range(3)
            ]
            low = [rng.uniform(-10, 0) for _ in outputs]
            high = [rng.uniform(0, 10) for _ in outputs]
            array = np.array(outputs, np.int16)
            box = BoxAction(tuple(low), tuple(high), (3,), "float64")
            assert box.decode(array, frac_bits).tolist() == second.decode_box(outputs, frac_bits, low, high)
            assert DiscreteAction(3, 7).decode(array, frac_bits) == second.decode_discrete(outputs, 7)


def _numbers(data: Any) -> Iterator[tuple[Any, Any]]:
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        if isinstance(value, int):
            yield data, key
        elif isinstance(value, (dict, list)):
            yield from _numbers(value)
