# SPDX-License-Identifier: MIT
"""State that a later command goes on from: JSON that carries a SHA-256 of itself, so that a damaged file is known for one.

The seal is the last entry of the object, ``"sha256"``, over every byte before the comma that it follows. It finds accidents; it is
no signature, since whoever writes a file can seal it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from bitneat.errors import BitneatError
from bitneat.files import read_capped, temporary_name, write_atomic

_SEAL = re.compile(rb',\s*"sha256":\s*"([0-9a-f]{64})"\s*\}\s*\Z')
_SEAL_BYTES = 200
"""More than a seal is long."""
MAX_CONTAINERS = 1 << 24
"""Lists and objects in a file, of which an empty one takes two bytes there and eighty in memory."""


class DamagedError(BitneatError):
    """A file is not what was written; an older one may be whole."""


def seal(data: Mapping[str, Any], *, indent: int | None = None, allow_nan: bool = False) -> bytes:
    """The JSON text of an object, sealed.

    Args:
        data: with at least one key; ``sha256`` must not be one.
        indent: as of `json.dumps`; None for the shortest text.
        allow_nan: whether infinities and NaN may occur, which JSON proper has not.

    Raises:
        ValueError: ``data`` holds what JSON cannot say.
    """
    separators = (",", ":") if indent is None else None
    text = json.dumps(data, indent=indent, separators=separators, ensure_ascii=False, allow_nan=allow_nan)
    content = text.removesuffix("}").rstrip().encode()
    space, colon = (b"\n" + b" " * indent, b": ") if indent is not None else (b"", b":")
    last = b"\n}\n" if indent is not None else b"}\n"
    return (
        content + b"," + space + b'"sha256"' + colon + b'"' + hashlib.sha256(content).hexdigest().encode() + b'"' + last
    )


def unseal(content: bytes, where: str, *, required: bool = True) -> Any:
    """The data in a sealed JSON text, without the seal; if it is not ``required``, that of JSON without one, too.

    Raises:
        DamagedError: naming ``where``, if a byte is another than was written, or it is no JSON.
        BitneatError: if there are more than `MAX_CONTAINERS` lists and objects in it.
    """
    data, sealed = _unsealed(content, where)
    if required and not sealed:
        raise DamagedError(f"{where}: damaged: it does not end with its SHA-256")
    return data


def is_whole(content: bytes) -> bool:
    """Whether a sealed text is as it was written."""
    match = _seal_of(content)
    return match is not None and _matches(content, match)


def _seal_of(content: bytes) -> re.Match[bytes] | None:
    return _SEAL.search(content, max(len(content) - _SEAL_BYTES, 0))


def _matches(content: bytes, match: re.Match[bytes]) -> bool:
    return hashlib.sha256(content[: match.start()]).hexdigest().encode() == match[1]


def _unsealed(content: bytes, where: str) -> tuple[Any, bool]:
    """The data, and whether it had a seal."""
    match = _seal_of(content)
    if match is not None and not _matches(content, match):
        raise DamagedError(f"{where}: damaged: its content has another SHA-256 than was written with it")
    if content.count(b"[") + content.count(b"{") > MAX_CONTAINERS:
        raise BitneatError(f"{where}: refused: more than {MAX_CONTAINERS} lists and objects")
    try:
        data = json.loads(content)
    except (ValueError, RecursionError):  # among them numbers of too many digits
        raise DamagedError(f"{where}: damaged: not JSON") from None
    if match is not None and isinstance(data, dict):
        data.pop("sha256", None)
    return data, match is not None


def read_state(path: Path, expected_format: str, version: int, limit: int) -> Mapping[str, Any]:
    """The object in a state file. Those of version 1 have no seal; all later ones must have one.

    Args:
        path: of the file.
        expected_format: value of its key ``format``.
        version: the newest that is read.
        limit: bytes at most.

    Raises:
        DamagedError: if it cannot be read, or is not as it was written.
        BitneatError: if it is of another format, or of a later version.
    """
    try:
        content = read_capped(path, limit, regular=True)
    except BitneatError as error:
        raise DamagedError(str(error)) from None
    data, sealed = _unsealed(content, str(path))
    if not isinstance(data, dict) or data.get("format") != expected_format:
        raise DamagedError(f"{path}: damaged: expected 'format': {expected_format!r}")
    found = data.get("version")
    if type(found) is int and found > version:
        raise BitneatError(f"{path}: version {found!s:.40}: this bitneat reads {version}")
    if type(found) is not int or found < 1:
        raise DamagedError(f"{path}: damaged: version {found!r:.40}")
    if found > 1 and not sealed:
        raise DamagedError(f"{path}: damaged: it does not end with its SHA-256")
    return data


class StateFile:
    """A checkpoint in one file, and beside it the one before, which is read if the newer one is damaged.

    Args:
        path: ``NAME.json``; the one before is ``NAME-previous.json``.
        expected_format: value of the key ``format``.
        version: of what is written, and the newest that is read; at least 2.
        limit: bytes that are read at most.
    """

    def __init__(self, path: Path, expected_format: str, version: int, limit: int) -> None:
        self.path = path
        self.previous = path.with_name(f"{path.stem}-previous{path.suffix}")
        self._format, self._version, self._limit = expected_format, version, limit

    def exists(self) -> bool:
        """Whether anything was ever saved."""
        return self.path.exists() or self.previous.exists()

    def save(self, data: Mapping[str, Any]) -> None:
        """Write the next state; at any moment two, or the first, are whole.

        Raises:
            FileError: if a file cannot be written.
            ValueError: if ``data`` holds a NaN or an infinity.
        """
        content = seal({"format": self._format, "version": self._version, **data})
        self._keep()
        write_atomic(self.path, content)

    def load(self, warn: Callable[[str], None]) -> tuple[Path, Mapping[str, Any]]:
        """The newest state that is whole, and its file; ``warn`` is told if that is not the newest.

        Raises:
            BitneatError: if there is none, or it is of a later version.
        """
        try:
            return self.path, read_state(self.path, self._format, self._version, self._limit)
        except DamagedError as error:
            try:
                data = read_state(self.previous, self._format, self._version, self._limit)
            except DamagedError:
                raise error from None
            warn(f"{error}; going on from {self.previous}")
        return self.previous, data

    def _keep(self) -> None:
        """Give the present file its second name, without a moment in which it has none."""
        try:
            content = read_capped(self.path, self._limit, regular=True)
        except BitneatError:
            return
        if not is_whole(content):  # it must not take the place of the one before
            return
        temporary = temporary_name(self.previous)
        try:
            os.link(self.path, temporary)
            temporary.replace(self.previous)
        except OSError:  # a file system without links
            write_atomic(self.previous, content)
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
