# SPDX-License-Identifier: MIT
"""Registers and memory of a symbolic machine: bytes of terms, and who may touch what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bitneat.prove.terms import Atom, Term, Terms


class Violation(Exception):  # noqa: N818 - a finding about the code under test, not an error of this program
    """The code does what it must not do, or does it depending on data."""


class Bytes:
    """Bytes by address, each of them a byte of some term."""

    def __init__(self, terms: Terms) -> None:
        self._terms = terms
        self._bytes: dict[int, tuple[Term, int]] = {}

    def write(self, address: int, term: Term) -> None:
        """Put a term there, the lowest byte first."""
        for index in range(term.width // 8):
            self._bytes[address + index] = (term, index)

    def has(self, address: int) -> bool:
        """Whether something was written there."""
        return address in self._bytes

    def read(self, address: int, size: int) -> Term:
        """``size`` bytes, all of which have been written."""
        first, index = self._bytes[address]
        count = first.width // 8
        if index + size <= count and all(
            self._bytes[address + i] == (first, index + i) for i in (range(size) if size > 1 else ())
        ):
            return self._terms.extract(first, 8 * index, 8 * size)
        parts = []
        at = 0
        while at < size:
            term, begin = self._bytes[address + at]
            length = 1
            while at + length < size and self._bytes[address + at + length] == (term, begin + length):
                length += 1
            parts.append(self._terms.extract(term, 8 * begin, 8 * length))
            at += length
        return self._terms.concat(parts)


@dataclass(frozen=True, slots=True)
class Region:
    """Addresses with a purpose. What nobody put there may be read only once the code has written it."""

    name: str
    addresses: range
    writable: bool


class Memory:
    """Memory of which every access is checked; whatever lies outside the regions belongs to somebody else."""

    def __init__(self, terms: Terms, regions: Sequence[Region], stack: Region) -> None:
        self._terms = terms
        self._bytes = Bytes(terms)
        self._regions = (*regions, stack)
        self._stack = stack
        self.lowest_stack = stack.addresses.stop
        """The lowest address of the stack that was touched."""

    def provide(self, address: int, term: Term) -> None:
        """Put something there before the code runs."""
        self._bytes.write(address, term)

    def load(self, address: int, size: int) -> Term:
        """What the code reads.

        Raises:
            Violation: if it may not.
        """
        region = self._region(address, size, "reads")
        if region is self._stack:
            self._touch(address)
            for one in range(address, address + size):
                if not self._bytes.has(one):
                    unknown = Atom(f"stack{one - region.addresses.stop:+d}", 0, 255, undefined=True)
                    self._bytes.write(one, self._terms.var(unknown, 8))
        elif not all(self._bytes.has(one) for one in range(address, address + size)):
            raise Violation(f"reads {self._where(region, address)} before it has written it")
        return self._bytes.read(address, size)

    def store(self, address: int, term: Term) -> None:
        """What the code writes.

        Raises:
            Violation: if it may not.
        """
        region = self._region(address, term.width // 8, "writes")
        if not region.writable:
            raise Violation(f"writes {self._where(region, address)}")
        if region is self._stack:
            self._touch(address)
        self._bytes.write(address, term)

    def result(self, address: int, size: int, name: str) -> Term:
        """What the code left there.

        Raises:
            Violation: if it wrote nothing.
        """
        if not all(self._bytes.has(one) for one in range(address, address + size)):
            raise Violation(f"does not write {name}")
        return self._bytes.read(address, size)

    def is_stack(self, address: int) -> bool:
        """Whether it lies on the stack."""
        return address in self._stack.addresses

    def _touch(self, address: int) -> None:
        self.lowest_stack = min(self.lowest_stack, address)

    def _region(self, address: int, size: int, what: str) -> Region:
        for region in self._regions:
            if address in region.addresses and address + size <= region.addresses.stop:
                return region
        for region in self._regions:
            if address < region.addresses.stop and address + size > region.addresses.start:
                raise Violation(
                    f"{what} beyond {region.name}: {size} bytes at offset {address - region.addresses.start}"
                )
        raise Violation(f"{what} {size} bytes at {address:#x}, which is none of its memory")

    @staticmethod
    def _where(region: Region, address: int) -> str:
        return f"{region.name} at offset {address - region.addresses.start}"
