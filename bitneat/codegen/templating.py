# SPDX-License-Identifier: MIT
"""The Jinja environment of the C templates."""

from __future__ import annotations

import contextlib
import hashlib
from functools import cache
from pathlib import Path

import jinja2
from jinja2.bccache import Bucket

from bitneat.errors import BitneatError
from bitneat.files import read_capped, write_atomic
from bitneat.native.build import cache_dir
from bitneat.native.data import templates_dir

_MAX_BYTECODE = 1 << 24


class _BytecodeCache(jinja2.BytecodeCache):
    """Compiled templates beside compiled C, each behind a hash of its bytes.

    Jinja's own cache of files reads one that a loss of power cut off, or a disk changed, as code to run.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def _path(self, bucket: Bucket) -> Path:
        return self._folder / f"template-{bucket.key}.bin"

    def load_bytecode(self, bucket: Bucket) -> None:
        """Fill the bucket, if its file is there and whole."""
        try:
            content = read_capped(self._path(bucket), _MAX_BYTECODE)
        except BitneatError:
            return
        if hashlib.sha256(content[32:]).digest() == content[:32]:
            bucket.bytecode_from_string(content[32:])

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep what is in the bucket; where that cannot be, it is compiled again the next time."""
        content = bucket.bytecode_to_string()
        with contextlib.suppress(BitneatError):
            write_atomic(self._path(bucket), hashlib.sha256(content).digest() + content)


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
        bytecode_cache=_BytecodeCache(cache_dir()),
    )
    result.filters["lines"] = lambda text: text.rstrip("\n")
    return result
