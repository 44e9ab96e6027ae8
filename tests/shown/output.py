# SPDX-License-Identifier: MIT
"""Whether a command printed what its page shows: word by word, with ``...`` for anything, numbers within a tolerance."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

ANYTHING = "..."
_NUMBER = re.compile(r"[-+]?\d[\d,]*(?:\.\d+)?")


def difference(shown: Sequence[str], printed: Sequence[str], tolerance: float = 0.0) -> str | None:
    """The first line shown that was not printed, in order; None if all were.

    A shown line ``...`` stands for any lines, a word ``...`` for any words of a line.
    """
    lines = [line.split() for line in printed if line.strip()]
    position, anywhere = 0, False
    for line in shown:
        words = line.split()
        if not words:
            continue
        if words == [ANYTHING]:
            anywhere = True
            continue
        last = len(lines) if anywhere else min(position + 1, len(lines))
        at = next((i for i in range(position, last) if _fits(words, lines[i], tolerance)), None)
        if at is None:
            return line.strip()
        position, anywhere = at + 1, False
    if position < len(lines) and not anywhere:
        return f"(nothing more, but {' '.join(lines[position])!r} was printed)"
    return None


def _fits(shown: Sequence[str], printed: Sequence[str], tolerance: float) -> bool:
    if not shown:
        return not printed
    if shown[0] == ANYTHING:
        return any(_fits(shown[1:], printed[i:], tolerance) for i in range(len(printed) + 1))
    return bool(printed) and _equal(shown[0], printed[0], tolerance) and _fits(shown[1:], printed[1:], tolerance)


def _equal(shown: str, printed: str, tolerance: float) -> bool:
    if shown == printed:
        return True
    if not tolerance or _NUMBER.sub("#", shown) != _NUMBER.sub("#", printed):
        return False
    pairs = zip(_NUMBER.findall(shown), _NUMBER.findall(printed), strict=True)
    return all(math.isclose(_value(one), _value(other), rel_tol=tolerance) for one, other in pairs)


def _value(text: str) -> float:
    return float(text.replace(",", ""))
