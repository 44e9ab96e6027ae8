# SPDX-License-Identifier: MIT
"""Where the files that are no Python lie: the Jinja templates of the generated C and the sources of the C runtime.

In a checkout, and so in an editable install too, they are the checkout's own, so that an edit takes effect at once; an
installed wheel carries a copy inside the package.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import bitneat
from bitneat.errors import BitneatError


def templates_dir() -> Path:
    """Return the folder of the Jinja templates."""
    return _folder("codegen/templates", "templates")


def runtime_dir() -> Path:
    """Return the folder that holds ``include/`` and ``src/`` of the C runtime."""
    return _folder("runtime_c", "runtime_c")


def _folder(in_checkout: str, in_wheel: str) -> Path:
    # An editable install leaves a copy of the wheel's data in site-packages as of the day it was made. It is never looked
    # at: the package's own location says that this is a checkout.
    root = Path(bitneat.__file__).resolve().parent.parent
    if (root / "pyproject.toml").is_file() and (root / in_checkout).is_dir():
        return root / in_checkout
    packaged = resources.files(bitneat) / "_data" / in_wheel
    if isinstance(packaged, Path) and packaged.is_dir():
        return packaged
    raise BitneatError(f"{packaged}: missing; bitneat is not installed completely, install it again")
