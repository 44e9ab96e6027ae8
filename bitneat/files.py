# SPDX-License-Identifier: MIT
"""Reading and writing of files as every part of bitneat does it: written whole or not at all, read up to a limit."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bitneat.errors import BitneatError

try:
    import fcntl
except ImportError:  # not on every system
    _LOCKS = False
else:
    _LOCKS = True

_TEMPORARY = re.compile(r"\..+\.(\d{1,10})\.[0-9a-f]{8}\.tmp")
"""Names of temporary files, with the number of the process that writes one."""


class FileError(BitneatError):
    """A file cannot be read or written; the message names it and says why."""


def write_atomic(path: str | os.PathLike[str], content: bytes) -> None:
    """Write ``content`` to ``path`` so that at any moment, and after a crash, the file is whole: the old or the new.

    The bytes go to a temporary file in the same folder, which is synced and renamed over ``path``; the folder is synced
    too, so that the rename survives a loss of power. Links are followed, an existing file keeps its mode, and what is
    no regular file (``/dev/stdout``, a pipe) is written straight. If anything fails, the old file stands and the
    temporary one is gone.

    Raises:
        FileError: The folder is missing or closed to us, the disk is full, or ``path`` is a folder.
    """
    target = Path(os.path.realpath(path))
    try:
        mode = _mode(target)
        if mode is not None and not stat.S_ISREG(mode):
            target.write_bytes(content)
        else:
            _replace(target, content, mode)
    except OSError as error:
        raise FileError(f"{path}: cannot write: {error.strerror or error}") from error


def require_writable(path: str | os.PathLike[str]) -> None:
    """Notice before the work, and not after it, that its result could not be written.

    Raises:
        FileError: The folder is missing or closed to us, or ``path`` is a folder. What is let pass may fail all the same.
    """
    target = Path(os.path.realpath(path))
    reason = None
    if target.is_dir():
        reason = errno.EISDIR
    elif not target.parent.is_dir():
        reason = errno.ENOTDIR if target.parent.exists() else errno.ENOENT
    elif (target.is_file() or not target.exists()) and not os.access(target.parent, os.W_OK | os.X_OK):
        reason = errno.EACCES
    if reason is not None:
        raise FileError(f"{path}: cannot write: {os.strerror(reason)}")


def write_json(path: str | os.PathLike[str], data: Any) -> None:
    """Write ``data`` to ``path`` as indented JSON with a final newline, as `write_atomic` writes.

    A byte of a path that is no UTF-8, half of a surrogate pair in Python, is JSON's escape for that half.

    Raises:
        FileError: As `write_atomic`.
        ValueError: ``data`` holds a NaN or an infinity, which JSON cannot say.
    """
    text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    write_atomic(path, text.encode(errors="backslashreplace"))


def make_folder(path: Path) -> bool:
    """Make a folder and those above it that are missing; what is in them later survives a loss of power.

    Returns:
        False if it was there already.

    Raises:
        FileError: It cannot be made, or is something else.
    """
    missing = [path, *path.parents]
    missing = missing[: next((i for i, folder in enumerate(missing) if folder.is_dir()), len(missing))]
    try:
        try:
            path.mkdir(parents=True)
            made = True
        except OSError:  # of a folder that is there some systems say that nothing may be made
            if not path.is_dir():
                raise
            made = False
        for folder in missing:  # a synced file is lost all the same where the name of its folder never reached the disk
            sync_folder(folder.parent)
    except OSError as error:
        raise FileError(f"{path}: cannot be made: {error.strerror or error}") from None
    return made


def refuse_links(folder: Path) -> None:
    """Refuse a run's folder, which may be a stranger's, if something in it is a link: writing would follow it.

    Raises:
        FileError: naming the first link.
    """
    try:
        links = sorted(entry for entry in folder.iterdir() if entry.is_symlink())
    except OSError as error:
        raise FileError(f"{folder}: cannot read: {error.strerror or error}") from None
    if links:
        raise FileError(
            f"{links[0]}: a link, which writing would follow out of the run's folder; put a file in its place"
        )


def remove_leftovers(folder: Path) -> None:
    """Delete the temporary files in ``folder`` of processes that died in the middle of `write_atomic`."""
    with contextlib.suppress(OSError):  # they harm nobody
        for entry in folder.iterdir():
            if (match := _TEMPORARY.fullmatch(entry.name)) and not _alive(int(match[1])):
                entry.unlink(missing_ok=True)


@contextlib.contextmanager
def sole_user(folder: Path, *inner: str) -> Iterator[None]:
    """Be the only process that writes into a run folder meanwhile; temporary files of processes that died there go.

    What holds the folder is the process: however it ends, the next may begin at once. Where there are no locks, nothing is held.

    Args:
        folder: of the run.
        inner: names of folders in it that the run writes into, too.

    Raises:
        BitneatError: if another process is at work there.
    """
    with contextlib.ExitStack() as held:
        if _LOCKS:
            descriptor = os.open(folder, os.O_RDONLY)
            held.callback(os.close, descriptor)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise BitneatError(
                    f"{folder}: another process is at work there; expected a run that none continues"
                ) from None
            except OSError:
                pass
        for place in (folder, *(folder / name for name in inner)):
            if not place.is_symlink():
                remove_leftovers(place)
        yield


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def read_capped(path: str | os.PathLike[str], limit: int, *, regular: bool = False) -> bytes:
    """Read the whole of ``path``, which may hold at most ``limit`` bytes, however large it claims to be.

    Args:
        path: of a file that the user named, which may be a pipe.
        limit: in bytes.
        regular: refuse what is no regular file, for a path that a stranger's folder has: one would wait for a pipe for ever.

    Raises:
        FileError: The file is missing, closed to us, no file, or larger than ``limit``.
    """
    try:
        if regular and not stat.S_ISREG(Path(path).stat().st_mode):
            raise FileError(f"{path}: cannot read: not a regular file")
        with Path(path).open("rb") as file:
            content = file.read(limit + 1)
    except OSError as error:
        raise FileError(f"{path}: cannot read: {error.strerror or error}") from error
    if len(content) > limit:
        raise FileError(f"{path}: larger than {limit} bytes, the most that is read of such a file")
    return content


def temporary_name(target: Path) -> Path:
    """A name beside ``target`` that no other process takes, for what is renamed when it is whole."""
    return target.with_name(f".{target.name}.{os.getpid()}.{os.urandom(4).hex()}.tmp")


def _mode(path: Path) -> int | None:
    try:
        return path.stat().st_mode
    except FileNotFoundError:
        return None


def _replace(target: Path, content: bytes, mode: int | None) -> None:
    temporary = temporary_name(target)
    try:
        # Not tempfile.mkstemp: its files are private, and a result should obey the umask like any other.
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        with os.fdopen(descriptor, "wb") as file:
            if mode is not None:
                os.fchmod(file.fileno(), stat.S_IMODE(mode))
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    except BaseException:
        with contextlib.suppress(OSError):  # the first error is the one to tell of
            temporary.unlink(missing_ok=True)
        raise
    sync_folder(target.parent)


def sync_folder(folder: Path) -> None:
    """Have the names in ``folder`` on the disk; on file systems that cannot do that, nothing is done."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)
