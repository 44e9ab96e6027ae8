# SPDX-License-Identifier: MIT
"""What is linked and loaded: where it may be changed, and where a machine's memory ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cffi
import numpy as np
import pytest

from bitneat.controller import Reference
from bitneat.errors import BitneatError
from bitneat.verify.targets import unicorn_emulator
from bitneat.verify.targets.image import Image, build_image, require_symbols
from bitneat.verify.targets.tracing import TRACE_DECLARATIONS, Recorder
from tests.verify.champions import champion, plain_champion, written
from tests.verify.targets.chips import emulated, ready


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Image:
    target, toolchain = ready("cortex-m0")
    names = ("bitneat_steps",)
    code = written(plain_champion(), tmp_path_factory.mktemp("image"))
    return build_image(code, toolchain, "step", batch=4, link_flags=target.emulator.link_flags(names))


@pytest.mark.parametrize(("first", "size"), [(0, 2), (4, 2), (-2, 2)])
def test_the_code_under_test_can_be_changed_from_its_first_byte_to_its_last(
    image: Image, first: int, size: int
) -> None:
    at = first % len(image.controller)
    changed = image.patched(image.code_range.start + at, b"\xaa\x55")
    wanted = bytearray(image.controller)
    wanted[at : at + size] = b"\xaa\x55"
    assert changed.controller == bytes(wanted)
    assert image.controller != changed.controller
    assert len(changed.content) == len(image.content)
    assert sum(a != b for a, b in zip(changed.content, image.content, strict=True)) <= 2


def test_nothing_else_can_be_changed(image: Image) -> None:
    code = image.code_range
    for address in (code.start - 2, code.start - 1, code.stop - 1, code.stop):
        with pytest.raises(ValueError, match=f"{address:#x} is outside the code under test"):
            image.patched(address, b"\0\0")


def test_a_program_without_code_of_the_controller_is_said(image: Image) -> None:
    nameless = replace(image, content=image.content.replace(b".controller\0", b".kontroller\0"))
    with pytest.raises(BitneatError, match=r"legs\.c: the linked program has no code of it$"):
        _ = nameless.code_range


def test_a_step_from_a_state_is_that_of_the_reference(tmp_path: Path) -> None:
    whose = champion(seed=3, recurrent=True)
    one = emulated("cortex-m0", written(whose, tmp_path))
    size = one.image.code.num_state
    assert size is not None
    inputs = np.array([[250, -200, 100], [5, 6, -7]], np.int16)
    expected = Reference(whose.controller).run(inputs.tolist())
    one.reset()
    one.step(inputs[0])
    state = np.frombuffer(one._machine.read("bitneat_state", 2 * size), "<i2")
    one.reset()
    assert one.step_from(state, inputs[1]).tolist() == expected[1]
    plain = emulated("cortex-m0", written(plain_champion(), tmp_path))
    assert (
        plain.step_from(state[:0], inputs[0]).tolist()
        == Reference(plain_champion().controller).run([inputs[0].tolist()])[0]
    )


def test_a_name_that_the_linked_program_lacks_is_said(image: Image) -> None:
    require_symbols(image, ("bitneat_steps", "legs_step"))
    with pytest.raises(BitneatError, match=r"legs\.c: the linked program lacks bitneat_wings$"):
        require_symbols(image, ("bitneat_steps", "bitneat_wings", "bitneat_tail"))


@pytest.fixture(scope="module")
def avr(tmp_path_factory: pytest.TempPathFactory) -> Any:
    target, toolchain = ready("avr")
    code = written(plain_champion(), tmp_path_factory.mktemp("avr"))
    image = build_image(code, toolchain, "step", batch=1, link_flags=target.emulator.link_flags(()))
    machine = target.emulator.load(image, traced_steps=1)
    yield SimpleNamespace(machine=machine, image=image)
    machine.close()


def test_an_array_ends_with_the_ram_of_the_chip(avr: Any) -> None:
    ram_end = 0x900  # the ATmega328P has 2 KB of RAM from 0x100 on
    room = ram_end - (avr.image.symbols["bitneat_inputs"] - 0x800000)
    content = bytes(range(1, 255))
    avr.machine.write("bitneat_inputs", content)
    assert avr.machine.read("bitneat_inputs", len(content)) == content
    assert len(avr.machine.read("bitneat_inputs", room)) == room
    for size in (room + 1, room + 2, 5000):
        with pytest.raises(BitneatError, match=r"legs\.c: its inputs and outputs do not fit into the RAM$"):
            avr.machine.read("bitneat_inputs", size)


def test_a_machine_is_freed_once(avr: Any, image: Image) -> None:
    for machine, place in (
        (ready("avr")[0].emulator.load(avr.image), "_machine"),
        (ready("cortex-m0")[0].emulator.load(image), "_engine"),
    ):
        assert getattr(machine, place) is not None
        for _ in range(2):
            machine.close()
            assert getattr(machine, place) is None


def test_a_chip_that_simavr_does_not_have_is_said(avr: Any) -> None:
    with pytest.raises(BitneatError, match=r"^simavr: cannot load .*legs\.c into its z80$"):
        replace(ready("avr")[0].emulator, mcu="z80").load(avr.image)


def test_the_stack_is_what_lies_between_the_data_and_the_end_of_the_ram(avr: Any) -> None:
    struct = avr.machine._recorder.struct
    assert (struct.stack_begin, struct.stack_end) == (avr.image.symbols["bitneat_data_end"] - 0x800000, 0x900)
    assert 0x100 < struct.stack_begin < 0x900


def test_a_machine_of_webassembly_counts_the_instructions_of_a_step(tmp_path: Path) -> None:
    one = emulated("wasm32", written(plain_champion(), tmp_path))
    trace = one.trace(np.array([[1, 2, 3], [4, 5, 6]], np.int16), 1)
    assert trace.instructions[0] == trace.instructions[1]
    assert 20 < trace.instructions[0] < 200


@pytest.fixture
def unicorn(image: Image) -> Iterator[Any]:
    machine = ready("cortex-m0")[0].emulator.load(image)
    yield machine
    machine.close()


def test_memory_that_is_not_there_is_said(unicorn: Any) -> None:
    unicorn._image.symbols["nowhere"] = 0x7FFF0000
    with pytest.raises(BitneatError, match=r"^unicorn: Invalid memory .*UNMAPPED"):
        unicorn.read("nowhere", 2)
    with pytest.raises(BitneatError, match=r"^unicorn: Invalid memory .*UNMAPPED"):
        unicorn.write("nowhere", b"12")


def test_a_constant_that_unicorn_does_not_know_asks_for_a_newer_one() -> None:
    with pytest.raises(BitneatError, match=r"^unicorn: does not know CPU_Z80; a newer version is needed"):
        ready("cortex-m0")[0].emulator.constant("CPU_Z80")


def test_a_package_without_its_library_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    empty = SimpleNamespace(__file__=str(tmp_path / "__init__.py"))
    monkeypatch.setattr(unicorn_emulator, "import_module", lambda name: empty)
    with pytest.raises(BitneatError, match=r"lib: has no Unicorn library; install unicorn again$"):
        unicorn_emulator._libraries.__wrapped__()


def test_a_page_that_is_not_there_lies_between_data_and_stack(unicorn: Any, image: Image) -> None:
    struct = unicorn._recorder.struct
    data_end = image.symbols["bitneat_data_end"]
    assert data_end + 0x1000 <= struct.stack_begin < data_end + 0x2000
    assert struct.stack_end - struct.stack_begin == 0x10000
    unicorn._image.symbols["between"] = struct.stack_begin - 2
    with pytest.raises(BitneatError, match=r"^unicorn: Invalid memory .*UNMAPPED"):
        unicorn.write("between", b"12")


@pytest.mark.parametrize(("done", "kept"), [(1, 1), (2, 2), (5, 2)])
def test_no_more_steps_are_told_than_there_is_room_for(done: int, kept: int) -> None:
    ffi = cffi.FFI()
    ffi.cdef(TRACE_DECLARATIONS)
    recorder = Recorder(ffi, range(0, 100), range(1000, 2000), 2)
    recorder.struct.num_steps = done
    recorder.struct.entry_sp, recorder.struct.lowest = 1900, 1880
    trace = recorder.result(return_bytes=4, has_cycles=False)
    assert (trace.steps, trace.stack, trace.cycles) == (kept, 24, None)
