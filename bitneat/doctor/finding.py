# SPDX-License-Identifier: MIT
"""One thing that was looked at, and how it is."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

State = Literal["found", "missing", "failed"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    Args:
        section: what kind of thing it is.
        name: what it is called.
        state: ``failed`` is there, and does not do what it should.
        detail: its version, or what was seen; what is wrong, where something is.
        enables: what it is for.
        remedy: how to get it, or to mend it; empty where nothing is to be done.
        required: whether evolve, codegen or verify cannot work without it.
    """

    section: str
    name: str
    state: State
    detail: str = ""
    enables: str = ""
    remedy: str = ""
    required: bool = False

    @property
    def blocks(self) -> bool:
        """Whether one of the three main commands cannot work because of it."""
        return self.required and self.state != "found"

    def to_data(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)
