# SPDX-License-Identifier: MIT
"""Foreign text made safe to stand in generated files."""

from __future__ import annotations

import re

MAX_COMMENT_LENGTH = 80


def comment_text(text: str) -> str:
    """One short line of letters, digits and ``._:/-``, every other character a dot: it can end no comment and no string."""
    return re.sub(r"[^A-Za-z0-9 ._:/-]", ".", text[:MAX_COMMENT_LENGTH])
