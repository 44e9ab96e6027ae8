# SPDX-License-Identifier: MIT
"""Whether an object that somebody compiled is one for a processor: by its ELF header, and on ARM by its build attributes."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

from elftools.common.exceptions import ELFError
from elftools.elf.elffile import ELFFile

from bitneat.errors import BitneatError
from bitneat.prove.execute import Processor

_ARM_ARCHITECTURES = {
    **dict(enumerate("pre-v4 v4 v4T v5T v5TE v5TEJ v6 v6KZ v6T2 v6K v7 v6-M v6S-M v7E-M v8-A v8-R".split())),
    16: "v8-M.baseline",
    17: "v8-M.mainline",
    21: "v8.1-M.mainline",
    22: "v9-A",
}
"""Of Tag_CPU_arch, as "Addenda to, and Errata in, the ABI for the Arm Architecture" numbers them."""
_FILE, _CPU_RAW_NAME, _CPU_NAME, _CPU_ARCH, _CPU_ARCH_PROFILE, _COMPATIBILITY = 1, 4, 5, 6, 7, 32


def require_made_for(content: bytes, path: Path, target: str, processor: Processor) -> None:
    """Refuse what is no relocatable object for a processor.

    Args:
        content: of the file.
        path: of the file, for the message.
        target: the processor's name, for the message.
        processor: which.

    Raises:
        BitneatError: saying what the file is and what was expected.
    """
    expected = f"expected an object that was compiled for {target}"
    if not content.startswith(b"\x7fELF"):
        raise BitneatError(f"{path}: not an ELF file, {expected}")
    try:
        elf = ELFFile(io.BytesIO(content))
        machine, kind = str(elf["e_machine"]), str(elf["e_type"])
        architecture = _arm_architecture(elf) if machine == "EM_ARM" else None
    # pyelftools raises what its parsers stumble over.
    except (ELFError, ValueError, LookupError, TypeError, AttributeError, OverflowError, AssertionError, OSError):
        raise BitneatError(f"{path}: a damaged ELF file, {expected}") from None
    order = "little" if elf.little_endian else "big"
    if (machine, elf.elfclass, order) != (processor.machine, processor.word, "little"):
        found = f"{machine.removeprefix('EM_')}, {elf.elfclass} bits, {order}-endian"
        wanted = f"{processor.machine.removeprefix('EM_')}, {processor.word} bits, little-endian"
        raise BitneatError(f"{path}: is for {found}; expected {wanted}, as {target} is")
    if kind != "ET_REL":
        raise BitneatError(f"{path}: is linked already, {expected}, as -c makes it")
    if processor.architectures and architecture not in processor.architectures:
        what = f"was compiled for ARM{architecture}" if architecture else "does not say for which ARM it was compiled"
        raise BitneatError(
            f"{path}: {what}, expected ARM{' or ARM'.join(processor.architectures)}, as {target} executes"
        )


def _arm_architecture(elf: ELFFile) -> str | None:
    """Such as ``v7E-M``; None if the object does not say."""
    for section in elf.iter_sections():
        if section["sh_type"] == "SHT_ARM_ATTRIBUTES":
            found = dict(_file_attributes(section.data(), "little" if elf.little_endian else "big"))
            number = found.get(_CPU_ARCH)
            if number is None:
                return None
            name = _ARM_ARCHITECTURES.get(number, f"-architecture {number}")
            return f"{name}-{chr(found[_CPU_ARCH_PROFILE])}" if name == "v7" and found.get(_CPU_ARCH_PROFILE) else name
    return None


def _file_attributes(data: bytes, order: str) -> Iterator[tuple[int, int]]:
    """Tags and numbers that hold for the whole of an object; texts are passed over.

    Raises:
        ValueError, IndexError: if they cannot be read.
    """
    if data[:1] != b"A":
        raise ValueError("unknown version of the attributes")
    at = 1
    while at < len(data):
        end = at + _word(data, at, order)
        start = data.index(b"\0", at + 4) + 1
        if data[at + 4 : start] == b"aeabi\0":
            while start < end:
                tag, inside = _uleb128(data, start)
                stop = start + _word(data, inside, order)
                if tag == _FILE:
                    yield from _numbers(data[:stop], inside + 4)
                start = _further(stop, start)
        at = _further(end, at)


def _numbers(data: bytes, at: int) -> Iterator[tuple[int, int]]:
    while at < len(data):
        tag, at = _uleb128(data, at)
        is_text = tag in (_CPU_RAW_NAME, _CPU_NAME) or (tag > _COMPATIBILITY and tag % 2)
        if not is_text:
            value, at = _uleb128(data, at)
            yield tag, value
        if is_text or tag == _COMPATIBILITY:
            at = data.index(b"\0", at) + 1


def _word(data: bytes, at: int, order: str) -> int:
    return int.from_bytes(data[at : at + 4], "little" if order == "little" else "big")


def _further(to: int, at: int) -> int:
    if to <= at:
        raise ValueError("a length that leads back")
    return to


def _uleb128(data: bytes, at: int) -> tuple[int, int]:
    """A number of seven bits a byte, the lowest first, and where it ends."""
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if not byte & 0x80:
            return value, at
