# SPDX-License-Identifier: MIT
"""State files that say anything, rightly sealed: what hostile hands can make, written from docs/file-formats.md alone."""

import hashlib
import json
from pathlib import Path
from typing import Any


def sealed(data: dict[str, Any]) -> str:
    """JSON with a hash of itself as the last entry."""
    text = json.dumps({key: value for key, value in data.items() if key != "sha256"})[:-1]
    return f'{text}, "sha256": "{hashlib.sha256(text.encode()).hexdigest()}"}}'


def resealed(path: Path, old: str, new: str) -> None:
    """Replace a text in a sealed file, and its hash."""
    text = path.read_text()
    assert old in text
    path.write_text(sealed(json.loads(text.replace(old, new))))
