# SPDX-License-Identifier: MIT
"""Bits in and out of bytes, the lowest bit of each byte first."""

from __future__ import annotations

from bitneat.errors import BitneatError

COUNT_GROUP = 5
"""A count is written in groups of five bits, lowest first, each followed by a bit that says whether another comes."""


class PackedFormatError(BitneatError):
    """A blob is not what the packed format allows."""


class BitWriter:
    """Collects bits; `to_bytes` pads the last byte with zeros."""

    def __init__(self) -> None:
        self._value = 0  # one large number: its operations are fast ones, bit by bit is not
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def put(self, value: int, width: int) -> None:
        """Append ``width`` bits of a value in 0..2^width-1, the lowest first."""
        if not 0 <= value < 1 << width:
            raise ValueError(f"{value} does not fit {width} bits")
        self._value |= value << self._length
        self._length += width

    def put_count(self, value: int) -> None:
        """Append a non-negative number of any size."""
        while True:
            self.put(value & ((1 << COUNT_GROUP) - 1), COUNT_GROUP)
            value >>= COUNT_GROUP
            self.put(int(value > 0), 1)
            if not value:
                return

    def put_rice(self, value: int, k: int) -> None:
        """Append ``value`` in the Rice code of parameter k: value >> k in ones and a zero, then its k low bits."""
        ones = value >> k
        self.put((1 << ones) - 1, ones + 1)
        self.put(value & ((1 << k) - 1), k)

    def align(self) -> None:
        """Append zeros up to the next whole byte."""
        self._length += -self._length % 8

    def to_bytes(self) -> bytes:
        """What was written, padded to whole bytes."""
        return self._value.to_bytes((self._length + 7) // 8, "little")


class BitReader:
    """Reads what a `BitWriter` wrote, and refuses to read past the end."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.position = 0

    def take(self, width: int) -> int:
        """The next ``width`` bits as a number."""
        if self.position + width > 8 * len(self._data):
            raise PackedFormatError(f"blob: ends after {len(self._data)} bytes, expected more")
        value = 0
        for i in range(width):
            at = self.position + i
            value |= (self._data[at >> 3] >> (at & 7) & 1) << i
        self.position += width
        return value

    def take_count(self, limit: int, what: str) -> int:
        """A count of at most ``limit``."""
        value = shift = 0
        while True:
            group = self.take(COUNT_GROUP)
            more = self.take(1)
            value |= group << shift
            shift += COUNT_GROUP
            if value > limit:
                raise PackedFormatError(f"blob: {what} is {value}, expected at most {limit}")
            if not more:
                if group == 0 and shift > COUNT_GROUP:
                    raise PackedFormatError(f"blob: {what} is written with a needless group")
                return value
            if shift > 30:
                raise PackedFormatError(f"blob: {what} is too long")

    def take_rice(self, k: int, limit: int, what: str) -> int:
        """A Rice-coded number of at most ``limit``."""
        quotient = 0
        while self.take(1):
            quotient += 1
            if quotient << k > limit:
                raise PackedFormatError(f"blob: {what} is beyond {limit}")
        value = quotient << k | self.take(k)
        if value > limit:
            raise PackedFormatError(f"blob: {what} is {value}, expected at most {limit}")
        return value

    def align(self) -> None:
        """Skip to the next whole byte; the bits between must be zero."""
        if self.take(-self.position % 8):
            raise PackedFormatError("blob: padding bits are not zero")

    def finish(self) -> None:
        """Refuse bytes that are left over."""
        self.align()
        if self.position != 8 * len(self._data):
            raise PackedFormatError(f"blob: {len(self._data) - self.position // 8} bytes too long")


def rice_cost(value: int, k: int) -> int:
    """Bits that `BitWriter.put_rice` writes."""
    return (value >> k) + 1 + k
