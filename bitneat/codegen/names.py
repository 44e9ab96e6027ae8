# SPDX-License-Identifier: MIT
"""Which names may prefix generated C."""

from __future__ import annotations

import re

from bitneat.errors import BitneatError

MAX_NAME_LENGTH = 40

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_C99_KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register"
    " restrict return short signed sizeof static struct switch typedef union unsigned void volatile while".split()
)
_CXX_KEYWORDS = frozenset(
    "alignas alignof and and_eq asm bitand bitor bool catch char8_t char16_t char32_t class co_await co_return co_yield"
    " compl concept consteval constexpr constinit const_cast decltype delete dynamic_cast explicit export false friend"
    " mutable namespace new noexcept not not_eq nullptr operator or or_eq private protected public reinterpret_cast"
    " requires static_assert static_cast template this thread_local throw true try typeid typename using virtual wchar_t"
    " xor xor_eq".split()
)
# What gcc and clang add to C unless -std=c99 is given, and C23 to it.
_GNU_KEYWORDS = frozenset("asm typeof typeof_unqual".split())
# Without an underscore, defined before the first line: by gcc and clang as they are called without -std, by target.
_PREDEFINED = frozenset(
    "AVR PPC WIN32 WIN64 WINNT bfin hpux i386 linux m68k mc68000 mips nios2 pdp11 sparc sun unix vax".split()
)
_RESERVED_WORDS = _C99_KEYWORDS | _CXX_KEYWORDS | _GNU_KEYWORDS
_HEADERS = frozenset(
    # of C23 and of those before it
    "assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg stdatomic"
    " stdbit stdbool stdckdint stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype"
    # of POSIX and C libraries, which include some of them in those
    " alloca dirent dlfcn endian fcntl features malloc memory newlib poll pthread sched strings unistd".split()
)
# Prefixes whose names a C library or bitneat's own runtime may define: uint8_t, INT16_MAX, str_..., mem_..., bn_....
_LIBRARY_PREFIXES = re.compile(r"(u?int(8|16|32|64|ptr|max)|str|mem|wcs|is|to|bn)(_|$)", re.IGNORECASE)


class CNameError(BitneatError):
    """A name cannot prefix C code."""


_FILE_STEM = re.compile(r"[A-Za-z0-9_+-][A-Za-z0-9_.+-]*")


def check_file_stem(stem: str, source: str) -> str:
    """The stem itself, if a generated source can include ``stem.h`` by name, and nobody gets it for a header of the system.

    Raises:
        CNameError: saying what is wrong and what was expected.
    """
    if not _FILE_STEM.fullmatch(stem):
        shown = stem if len(stem) <= 50 and stem.isprintable() else repr(stem[:50])
        raise CNameError(f"{source}: {shown!r} cannot name C files (letters, digits, _, +, - and dots)")
    if stem.lower() in _HEADERS:  # on some systems capitals are the same
        raise CNameError(f"{source}: {stem}.h is a header of the C library, which it would hide; choose another name")
    return stem


def _check_word(name: str, source: str) -> None:
    if name in _RESERVED_WORDS:
        raise CNameError(f"{source}: {name!r} is a reserved word of C or C++; choose another name")
    if name in _PREDEFINED or name.startswith("TARGET_OS_"):
        raise CNameError(f"{source}: {name!r} is a macro that some compilers define; choose another name")


def check_name(name: str, source: str = "--name") -> str:
    """The name itself, if ``name_step``, ``NAME_H`` and the like are fine identifiers in C and C++.

    Args:
        name: what generated functions, types and macros will start with.
        source: where it came from, for the message.

    Raises:
        CNameError: saying what is wrong and what was expected.
    """
    shown = name if len(name) <= 50 and name.isprintable() else repr(name[:50])
    if not _IDENTIFIER.fullmatch(name):
        raise CNameError(f"{source}: {shown!r} is no C identifier (letters, digits and _, no digit first)")
    _check_word(name, source)
    if name.startswith("_") or "__" in name or name.endswith("_"):
        raise CNameError(f"{source}: {shown!r} makes names that C and C++ reserve (a leading or a double _)")
    if _LIBRARY_PREFIXES.match(name) or name.lower().startswith("bitneat") or name == "main":
        raise CNameError(f"{source}: {shown!r} makes names that belong to the C library or to bitneat's runtime")
    if len(name) > MAX_NAME_LENGTH:
        raise CNameError(f"{source}: {len(name)} characters long, expected at most {MAX_NAME_LENGTH}")
    return name


def check_member_name(name: str, source: str) -> str:
    """The name itself, if a member of a struct can have it in C and C++.

    Raises:
        CNameError: saying what is wrong and what was expected.
    """
    shown = name if len(name) <= 50 and name.isprintable() else repr(name[:50])
    if not _IDENTIFIER.fullmatch(name):
        raise CNameError(f"{source}: {shown!r} is no C identifier (letters, digits and _, no digit first)")
    _check_word(name, source)
    if name.startswith("_") or "__" in name or _LIBRARY_PREFIXES.match(name):
        raise CNameError(f"{source}: {shown!r} may be a macro of the C library or reserved; choose another name")
    if len(name) > MAX_NAME_LENGTH:
        raise CNameError(f"{source}: {len(name)} characters long, expected at most {MAX_NAME_LENGTH}")
    return name
