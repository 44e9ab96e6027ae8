# SPDX-License-Identifier: MIT
"""Writing a package: a new folder appears whole or not at all, an old package is renewed, nothing else is touched."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from bitneat.codegen.package.files import MANIFEST
from bitneat.codegen.package.view import PackageError
from bitneat.errors import BitneatError
from bitneat.files import make_folder, read_capped, sync_folder, temporary_name, write_atomic

MAX_MANIFEST_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class _Manifest:
    kind: str
    name: str
    files: tuple[str, ...]


def write_package(folder: Path, kind: str, name: str, files: Mapping[str, str]) -> None:
    """Write the files of a package into ``folder``.

    A folder that does not exist, or is empty, is made beside its place and renamed; missing ones above it are made first. One
    that holds a package of this kind and name is renewed file by file, each whole at any moment, the manifest last; then files
    of the old package that the new one has no more are removed. What the user put beside them stays.

    Raises:
        BitneatError: if ``folder`` is anything else, or cannot be written.
    """
    old = _existing(folder, kind, name)
    try:
        if old is None:
            _make(folder, files)
        else:
            _renew(folder, old, files)
    except OSError as error:
        raise PackageError(f"{folder}: cannot write: {error.strerror or error}") from error


def _existing(folder: Path, kind: str, name: str) -> _Manifest | None:
    """The package that is there; None if the place is free."""
    try:
        entries = list(folder.iterdir())
    except FileNotFoundError:
        if folder.is_symlink():
            raise PackageError(f"{folder}: a link to nowhere; expected a new folder or a {kind} package") from None
        return None
    except OSError as error:
        raise PackageError(f"{folder}: cannot be a package's folder: {error.strerror or error}") from error
    if not entries:
        return None
    found = _read_manifest(folder / MANIFEST)
    if found is None:
        raise PackageError(f"{folder}: holds files but no package of bitneat; name a new or an empty folder")
    if (found.kind, found.name) != (kind, name):
        raise PackageError(
            f"{folder}: holds the {found.kind} package of {found.name}, not a {kind} package of {name};"
            " name another folder, or delete this one"
        )
    return found


def _read_manifest(path: Path) -> _Manifest | None:
    """The manifest, or None for anything that `package_files` does not write."""
    try:
        data = json.loads(read_capped(path, MAX_MANIFEST_BYTES, regular=True))
    except (BitneatError, ValueError, RecursionError):
        return None
    if not isinstance(data, dict) or data.get("format") != "bitneat-package":
        return None
    kind, name, files = data.get("kind"), data.get("name"), data.get("files")
    if not isinstance(kind, str) or not isinstance(name, str) or not isinstance(files, list):
        return None
    if not (kind.isidentifier() and name.isidentifier() and all(isinstance(entry, str) for entry in files)):
        return None
    return _Manifest(kind, name, tuple(entry for entry in files if _stays_inside(entry)))


def _stays_inside(path: str) -> bool:
    """Whether a path of a manifest, which anybody may have edited, names something below the folder."""
    parts = PurePosixPath(path)
    return bool(parts.parts) and not parts.is_absolute() and ".." not in parts.parts and path.isprintable()


def _make(folder: Path, files: Mapping[str, str]) -> None:
    target = Path(os.path.realpath(folder))
    temporary = temporary_name(target)
    make_folder(target.parent)
    try:
        temporary.mkdir()
        _write_all(temporary, files)
        temporary.rename(target)  # an empty folder gives way
        sync_folder(target.parent)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _refuse_links(folder: Path, paths: Iterable[str]) -> None:
    """A link in a stranger's package would have us write, or delete, elsewhere."""
    for path in paths:
        below = folder
        for part in PurePosixPath(path).parts:
            below /= part
            if below.is_symlink():
                raise PackageError(
                    f"{below}: a link, which leads out of the package; put a file or folder in its place"
                )


def _renew(folder: Path, old: _Manifest, files: Mapping[str, str]) -> None:
    _refuse_links(folder, (*files, *old.files))
    _write_all(folder, files)
    for path in old.files:
        if path not in files:
            (folder / path).unlink(missing_ok=True)


def _write_all(folder: Path, files: Mapping[str, str]) -> None:
    for path, text in files.items():
        target = folder / path
        make_folder(target.parent)
        write_atomic(target, text.encode("ascii"))
