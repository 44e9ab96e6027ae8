# SPDX-License-Identifier: MIT
"""The folder of a run of ``bitneat distill``: what was asked for is in ``distill.json``, and the same command goes on."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bitneat.errors import BitneatError
from bitneat.files import read_capped, refuse_links, sole_user, write_json
from bitneat.folders import DISTILL, begun

RUN = "distill.json"
_MAX_BYTES = 1 << 20


@contextlib.contextmanager
def at_work(folder: Path, run: dict[str, Any]) -> Iterator[None]:
    """Be the only process at work in the run's folder, which is made if it is missing.

    Args:
        folder: new, or of the same run.
        run: all that decides the result, as plain data.

    Raises:
        BitneatError: if the folder holds another run, or a file that this one would write or go on from; or another process is at
            work there.
    """
    path = folder / RUN
    if path.exists():
        refuse_links(folder)
        if _read(path) != run:
            raise BitneatError(f"{folder}: holds another run of distill; give another -o")
        with sole_user(folder):
            yield
        return
    with begun(folder, DISTILL):
        write_json(path, run)
        yield


def _read(path: Path) -> Any:
    try:
        return json.loads(read_capped(path, _MAX_BYTES, regular=True))
    except (ValueError, RecursionError):
        raise BitneatError(f"{path}: damaged: no JSON") from None
