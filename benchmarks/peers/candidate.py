# SPDX-License-Identifier: MIT
"""What is built and measured: C sources around one function, and what its numbers stand for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Element = Literal["int8_t", "int16_t", "int32_t", "float"]


class CannotExpressError(Exception):
    """A generator has no way to say this network; the message says why."""


@dataclass(frozen=True)
class Candidate:
    """One generator's code for one network.

    ``call`` is a C statement that computes the array ``output`` from the array ``input``, both of ``element``. ``unit`` is the
    number that stands for 1.0, so that signals of 2^F can be converted. ``expected`` gives the outputs in the element's own
    numbers if they are another network's than the reference's (fewer bits), else None.
    """

    name: str
    note: str
    sources: dict[str, str]
    prologue: str
    call: str
    element: Element
    unit: float
    include: tuple[Path, ...] = ()
    expected: Callable[[Sequence[int]], list[int]] | None = None
