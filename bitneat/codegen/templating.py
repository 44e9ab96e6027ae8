# SPDX-License-Identifier: MIT
"""The Jinja environment of the C templates."""

from __future__ import annotations

from functools import cache

import jinja2

from bitneat.native.build import cache_dir
from bitneat.native.data import templates_dir


@cache
def environment() -> jinja2.Environment:
    """Templates that fail on an undefined name and keep their white space as it is laid out."""
    # Nothing is escaped: the views give names checked to be C identifiers, numbers, and comment text made safe beforehand.
    result = jinja2.Environment(
        loader=jinja2.FileSystemLoader(templates_dir()),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
        # Compiled templates are kept beside compiled C, under a hash of their source.
        bytecode_cache=jinja2.FileSystemBytecodeCache(str(cache_dir())),
    )
    result.filters["lines"] = lambda text: text.rstrip("\n")
    return result
