# SPDX-License-Identifier: MIT
"""Building C for this machine, once: shared libraries are kept in a cache folder under all that decides their bytes."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

from bitneat.native.compiler import Compiler, CompilerError, host_compiler

_HEADER_SUFFIXES = frozenset({".h", ".hpp", ".inc"})
_INCLUDED_SOURCE = re.compile(rb'^[ \t]*#[ \t]*include[ \t]*"([^"\n]+\.c)"', re.MULTILINE)
_SEAL = b"\nbitneat SHA-256 "
_UNUSED_AFTER_SECONDS = 30 * 24 * 3600

announce: Callable[[str], None] | None = None
"""Called with a library's name before it is compiled, which may take seconds; the command line tells its user."""


def shared_library(
    sources: Sequence[Path],
    *,
    name: str,
    include_dirs: Sequence[Path] = (),
    flags: Sequence[str] = (),
    defines: Mapping[str, str] | None = None,
    compiler: Compiler | None = None,
) -> Path:
    """Compile ``sources`` into a shared library, or find it in the cache, and return its path.

    The cache key covers the contents of the sources, of C files that they include from beside them, of every header beside
    them and under ``include_dirs``, the flags and definitions, the compiler and its version, and the processor's features
    where the flags ask for the native ones. Any number of processes may build the same library at the same time: each
    writes a file of its own and renames it.

    Args:
        sources: C files.
        name: A word for the library's file name, so that a person can tell one from another.
        include_dirs: Folders for ``-I``, searched in this order.
        flags: Passed as they are (``-std=c99``, ``-O2``, …); nothing but ``-shared -fPIC`` is added.
        defines: Macros for ``-D``.
        compiler: The host's compiler if not given.

    Raises:
        CompilerError: There is no compiler, or it refused; the message holds its first error.
    """
    compiler = compiler or host_compiler()
    arguments = [*flags, *(f"-D{macro}={value}" for macro, value in sorted((defines or {}).items()))]
    key = _key(sources, include_dirs, arguments, compiler)
    target = cache_dir() / f"{name}-{key}.so"
    if _is_whole(target):
        _mark_used(target)
        return target
    command = [
        *(argument for argument in arguments if not argument.startswith("-l")),
        *(f"-I{folder}" for folder in include_dirs),
        "-shared",
        "-fPIC",
        *(str(source) for source in sources),
        *(argument for argument in arguments if argument.startswith("-l")),
    ]
    if announce is not None:
        announce(name)
    _build(compiler, command, target, what=str(sources[0]), sealed=True)
    _drop_unused(target.parent)
    return target


def compile_object(source: Path, compiler: Compiler, flags: Sequence[str], out: Path) -> None:
    """Compile one source to the object file ``out`` with any compiler, a cross compiler included; nothing is cached.

    Raises:
        CompilerError: The compiler refused; the message holds its first error.
    """
    _build(compiler, [*flags, "-c", str(source)], out, what=str(source))


def link_program(objects: Sequence[Path], compiler: Compiler, flags: Sequence[str], out: Path, *, what: str) -> None:
    """Link objects to the program ``out`` through their compiler; nothing is cached, nothing is added.

    Raises:
        CompilerError: The linker refused; the message names ``what`` and holds its first error.
    """
    _build(compiler, [*flags, *(str(path) for path in objects)], out, what=what)


def cache_dir() -> Path:
    """Return the folder of compiled libraries, made if need be.

    It is ``$BITNEAT_CACHE_DIR``, else ``bitneat`` in the XDG cache folder, else, where that cannot be written, a folder
    in the system's temporary one that nobody but this user may touch.
    """
    return _cache_dir(
        os.environ.get("BITNEAT_CACHE_DIR", ""), os.environ.get("XDG_CACHE_HOME", ""), os.environ.get("HOME", "")
    )


@cache
def _cache_dir(named: str, xdg: str, home: str) -> Path:
    if named:
        wanted = Path(named).absolute()
    elif Path(xdg).is_absolute():
        wanted = Path(xdg) / "bitneat"
    else:
        wanted = Path(home or "/nonexistent") / ".cache" / "bitneat"
    if _writable(wanted):
        return wanted
    return _private_temporary_dir()


def _writable(folder: Path) -> bool:
    """Try it: permission bits say nothing of a read-only or a full file system."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"\0")
    except OSError:
        return False
    return True


def _private_temporary_dir() -> Path:
    """Return a folder under the temporary one, shared by this user's processes.

    What is loaded from it runs as this user, so a folder that someone else made, or may write, is never used.
    """
    folder = Path(tempfile.gettempdir()) / f"bitneat-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700)
    except FileExistsError:
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
            return Path(tempfile.mkdtemp(prefix="bitneat-"))
    return folder


def _key(sources: Sequence[Path], include_dirs: Sequence[Path], arguments: Sequence[str], compiler: Compiler) -> str:
    parts = ["bitneat native build 1", sys.platform, platform.machine(), *compiler.command, compiler.version]
    parts += ["arguments", *arguments]
    if _follows_the_processor(compiler, arguments):
        parts += ["processor", _processor_features()]
    for file in _inputs(sources, include_dirs):
        parts += [file.name, hashlib.sha256(_read(file)).hexdigest()]
    # A length before each part, so that no two lists of parts give the same text.
    return hashlib.sha256("".join(f"{len(part)}:{part}" for part in parts).encode(errors="surrogateescape")).hexdigest()


def _inputs(sources: Sequence[Path], include_dirs: Sequence[Path]) -> Iterator[Path]:
    """Give every file that the compiler may read, the system's own headers apart, in a fixed order."""
    yield from sources
    for source in sources:
        # A source that is compiled several times, with other macros, is one that others include.
        included = (source.parent / os.fsdecode(name) for name in _INCLUDED_SOURCE.findall(_read(source)))
        yield from (path for path in included if path.is_file())
    for folder in dict.fromkeys(source.parent for source in sources):
        yield from sorted(path for path in folder.iterdir() if _is_header(path))
    for folder in include_dirs:
        yield from sorted(path for path in folder.rglob("*") if _is_header(path))


def _is_header(path: Path) -> bool:
    # A pipe named like a header would never end, and a folder or a broken link cannot be read.
    return path.suffix in _HEADER_SUFFIXES and path.is_file()


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise CompilerError(f"{path}: cannot read: {error.strerror or error}") from error


def _follows_the_processor(compiler: Compiler, arguments: Sequence[str]) -> bool:
    chosen = [argument for argument in arguments if argument.startswith(("-march=", "-mcpu="))]
    if any(argument.endswith("=native") for argument in chosen):
        return True
    # zig cc takes the processor it runs on for its target unless told otherwise.
    return compiler.family == "zig" and not chosen and "-target" not in compiler.command


@cache
def _processor_features() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    wanted = ("flags", "Features", "isa", "model name", "CPU part")
    return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))


def _build(compiler: Compiler, arguments: Sequence[str], target: Path, *, what: str, sealed: bool = False) -> None:
    """Run the compiler into a temporary file beside ``target`` and rename it, so that ``target`` is whole or absent.

    ``sealed`` is for what is kept: a hash is appended, which loaders do not look at, and the file is on the disk first.
    """
    temporary = target.with_name(f".{target.name}.{os.getpid()}.{os.urandom(4).hex()}.tmp")
    quiet = ["-fno-sanitize=undefined"] if compiler.family == "zig" else []  # zig cc traps on it by default
    try:
        done = subprocess.run(
            [*compiler.command, *quiet, *arguments, "-o", str(temporary)],
            capture_output=True,
            stdin=subprocess.DEVNULL,
            text=True,
            errors="replace",
            check=False,
            env=_environment(compiler),
        )
        name = Path(compiler.command[0]).name
        if done.returncode != 0:
            raise CompilerError(f"{what}: {name} failed: {_first_error(done.stderr)}")
        if not temporary.is_file():
            raise CompilerError(f"{what}: {name} ended well and made no file: expected a C compiler")
        if sealed:
            _seal(temporary)
        temporary.replace(target)
    except OSError as error:
        raise CompilerError(f"{what}: cannot compile into {target.parent}: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def _seal(library: Path) -> None:
    with library.open("r+b") as file:
        digest = hashlib.sha256(file.read()).hexdigest()
        file.write(_SEAL + digest.encode())
        file.flush()
        os.fsync(file.fileno())


def _is_whole(library: Path) -> bool:
    """Whether a library is there and as it was written: one cut off by a loss of power would crash who loads it."""
    try:
        content = library.read_bytes()
    except OSError:
        return False
    body, seal, digest = content.rpartition(_SEAL)
    return bool(seal) and hashlib.sha256(body).hexdigest().encode() == digest


def _environment(compiler: Compiler) -> dict[str, str]:
    environment = {**os.environ, "LC_ALL": "C"}
    if compiler.family == "zig":
        # Its own cache would go to the home folder, which need not be writable.
        zig_cache = str(cache_dir() / "zig")
        environment.setdefault("ZIG_GLOBAL_CACHE_DIR", zig_cache)
        environment.setdefault("ZIG_LOCAL_CACHE_DIR", zig_cache)
    return environment


def _first_error(messages: str) -> str:
    lines = [line.strip() for line in messages.splitlines() if line.strip()]
    for line in lines:
        if "error:" in line or "undefined reference" in line:
            return line
    return lines[-1] if lines else "it said nothing"


def _mark_used(library: Path) -> None:
    # Someone else's cache, or a read-only one, works as well; it only ages.
    with suppress(OSError):
        os.utime(library)


def _drop_unused(folder: Path) -> None:
    """Delete libraries, and what killed builds left, that nothing has asked for in a month."""
    oldest = time.time() - _UNUSED_AFTER_SECONDS
    for path in folder.iterdir():
        if path.suffix not in (".so", ".tmp", ".bin"):
            continue
        with suppress(OSError):  # another process may be quicker
            if path.stat().st_mtime < oldest:
                path.unlink()
