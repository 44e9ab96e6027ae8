# SPDX-License-Identifier: MIT
"""Checkpoints of trainings with PyTorch: tensors, numbers and lists of these, which are read without running anything."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bitneat.errors import BitneatError
from bitneat.files import read_capped, write_atomic

_CAP = 1 << 30


def save(path: Path, state: Any) -> None:
    """Write a checkpoint, whole or not at all."""
    import torch

    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_atomic(path, buffer.getvalue())


def restore(path: Path, take: Callable[[Any], None]) -> bool:
    """Give ``take`` what was saved; False if nothing was.

    Raises:
        BitneatError: if the file is damaged, or ``take`` cannot use what is in it.
    """
    if not path.exists():
        return False
    content = io.BytesIO(read_capped(path, _CAP, regular=True))
    import torch

    try:
        with zipfile.ZipFile(content) as archive:  # torch is built to skip the checksums in it
            bad = archive.testzip()
        if bad is not None:
            raise BitneatError(f"{bad!r:.80} has another checksum")
        content.seek(0)
        take(torch.load(content, weights_only=True))
    except Exception as error:  # the file may be anyone's
        reason = str(error) if isinstance(error, BitneatError) else type(error).__name__
        raise BitneatError(f"{path}: damaged: {reason}; remove it to begin anew") from None
    return True
