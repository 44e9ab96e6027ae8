# SPDX-License-Identifier: MIT
"""Mutants of C: of the runtime's sources, of the templates, and of the C that Python prints.

A mutant is one change of the text: an operator exchanged or dropped, a constant moved or zeroed, a term or a statement
dropped, a type narrowed, the condition of a template negated. Comments, texts of the preprocessor and Jinja's expressions are
left alone. So are the lines that the host's gcc never compiles (AVR, Thumb, clang: `bitneat verify --targets` runs those), and
empty assembly and barriers, which carry a value through unchanged and only bind the compiler.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

_OPERATORS: tuple[tuple[str, str], ...] = (
    ("<<=", ">>="),
    (">>=", "<<="),
    ("&&", "||"),
    ("||", "&&"),
    ("++", ""),
    ("--", ""),
    ("+=", "-="),
    ("-=", "+="),
    ("|=", "&="),
    ("&=", "|="),
    ("^=", "|="),
    ("==", "!="),
    ("!=", "=="),
    ("<=", "<"),
    (">=", ">"),
    ("->", "->"),
    ("<<", ">>"),
    (">>", "<<"),
    ("<", "<="),
    (">", ">="),
    ("+", "-"),
    ("-", "+"),
    ("&", "|"),
    ("|", "&"),
    ("^", "&"),
    ("~", ""),
    ("!", ""),
)
_OPERATOR = re.compile("|".join(re.escape(before) for before, _ in _OPERATORS))
_EXCHANGED = dict(_OPERATORS)
_BINARY_ONLY = frozenset({"+", "-", "&", "*"})
_NUMBER = re.compile(r"(?<![\w.%])(0[xX][0-9a-fA-F]+|\d+)(U?)(?![\w.])")
_TERM = re.compile(r" (?:[+\-&|^]|<<|>>) ~?(?:[A-Za-z_]\w*|\d+U?)(?![\w(\[.\-])")
_TYPE = re.compile(r"\b(uint32_t|int32_t|uint16_t|int16_t|size_t|unsigned|int)\b(?! long| short| char)")
_NARROWER = {
    "uint32_t": "uint16_t",
    "int32_t": "int16_t",
    "uint16_t": "uint8_t",
    "int16_t": "int8_t",
    "size_t": "uint8_t",
    "unsigned": "unsigned char",
    "int": "signed char",
}
_STATEMENT = re.compile(
    r"^([ ]+)((?! |const |return|static |struct |enum |for |unsigned |u?int|size_t|\}|#|/|case|default|break)"
    r"[^;{}\n]*[^;{}\s][^;{}\n]*;)",
    re.MULTILINE,
)
_CONDITION = re.compile(r"\{% (if|elif) (.+?) %\}")
_JINJA_TYPE = re.compile(r"\{\{ (?:m\.|u\.)?word \}\}")

_FOREIGN = re.compile(r"__clang__|__AVR|__thumb|__cplusplus|_FAST\)")
_DIRECTIVE = re.compile(r"[ \t]*#[ \t]*(if|ifdef|ifndef|elif|else|endif)\b(.*)")


@dataclass(frozen=True)
class Mutant:
    """One change of a text."""

    path: str
    line: int
    kind: str
    before: str
    """The line, stripped."""
    after: str
    start: int
    end: int
    text: str
    number: int

    @property
    def key(self) -> tuple[str, str, str]:
        """What names it in the list of survivors, wherever its line moves to."""
        return (self.path, self.before, self.after)

    def applied(self, source: str) -> str:
        """The text with the mutant in it."""
        return source[: self.start] + self.text + source[self.end :]


def mutants(path: str, source: str) -> list[Mutant]:
    """All mutants of a C source, a template, or the C texts of a Python module, in the order of their places."""
    is_python = path.endswith(".py")
    visible = _python_texts(source) if is_python else _code(source)
    changes = set(_changes(visible, is_python=is_python, templates=path.endswith(".j2")))
    if path.endswith(".j2"):
        changes |= set(_conditions(source))
    found = []
    seen = set()
    for start, end, text, kind in sorted(changes):
        line_start = source.rfind("\n", 0, start) + 1
        line_end = source.find("\n", end)
        before = source[line_start:line_end].strip()
        after = (source[line_start:start] + text + source[end:line_end]).strip()
        if before == after or (start, end, text) in seen:
            continue
        seen.add((start, end, text))
        line = source.count("\n", 0, start) + 1
        found.append(Mutant(path, line, kind, before, after, start, end, text, len(found)))
    return found


def _changes(visible: str, *, is_python: bool, templates: bool) -> Iterator[tuple[int, int, str, str]]:
    for found in _OPERATOR.finditer(visible):
        operator = found[0]
        after = _EXCHANGED[operator]
        if operator == after or (operator in _BINARY_ONLY and not _is_binary(visible, found)):
            continue
        if operator in ("<", ">") and "include" in _line(visible, found.start()):
            continue
        yield found.start(), found.end(), after, "operator"
    for found in _NUMBER.finditer(visible):
        value = int(found[1], 0)
        yield found.start(), found.end(), f"{value + 1}{found[2]}", "constant"
        if value:
            yield found.start(), found.end(), f"0{found[2]}", "constant"
        if value > 1:
            yield found.start(), found.end(), f"{value - 1}{found[2]}", "constant"
    for found in _TERM.finditer(visible):
        yield found.start(), found.end(), "", "term"
    for found in _TYPE.finditer(visible):
        yield found.start(), found.end(), _NARROWER[found[0]], "type"
    if not is_python:
        for found in _STATEMENT.finditer(visible):
            yield found.start(2), found.end(2), ";", "statement"
    if templates:
        for found in _JINJA_TYPE.finditer(visible):
            yield found.start(), found.end(), "uint16_t", "type"


def _conditions(source: str) -> Iterator[tuple[int, int, str, str]]:
    for found in _CONDITION.finditer(_without_foreign(source)):
        yield found.start(2), found.end(2), f"not ({found[2]})", "condition"


def _is_binary(text: str, found: re.Match[str]) -> bool:
    return text[found.start() - 1] == " " and text[found.end() : found.end() + 1] == " "


def _line(text: str, at: int) -> str:
    return text[text.rfind("\n", 0, at) + 1 : text.find("\n", at)]


def _blank(text: str) -> str:
    return re.sub(r"\S", " ", text)


_HIDDEN = (
    re.compile(r"/\*.*?\*/", re.DOTALL),
    re.compile(r"//[^\n]*"),
    re.compile(r"\{#.*?#\}", re.DOTALL),
    re.compile(r"\{%.*?%\}", re.DOTALL),
    re.compile(r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*", re.MULTILINE),
    re.compile(r"^[^\n]*(?:__asm__|_KEEP_LOOP|\(void\))[^\n]*$", re.MULTILINE),
    # Declarations repeat what definitions say, and do not compile if they say something else.
    re.compile(r"^(?:static )?(?:const )?\w[\w ]*\*?[\w]+\([^{}]*?\)(?=\s*[{;])", re.MULTILINE | re.DOTALL),
)


def _code(source: str) -> str:
    """The text with blanks for what is no C that the host compiles; every place stays where it is."""
    text = _without_foreign(source)
    for pattern in _HIDDEN:
        text = pattern.sub(lambda found: _blank(found[0]), text)
    # Of an expression of Jinja a letter stays, so that `+ {{ x }}` is still a sum.
    return re.sub(
        r"\{\{.*?\}\}", lambda found: found[0] if _JINJA_TYPE.fullmatch(found[0]) else "j" * len(found[0]), text
    )


def _without_foreign(source: str) -> str:
    lines = []
    hidden: list[bool] = []
    for line in source.splitlines(keepends=True):
        directive = _DIRECTIVE.match(line)
        if directive is not None:
            kind, condition = directive[1], directive[2]
            if kind == "endif":
                hidden.pop()
            elif kind in ("if", "ifdef", "ifndef"):
                hidden.append(_FOREIGN.search(condition) is not None)
            elif kind == "elif":
                hidden[-1] = _FOREIGN.search(condition) is not None
            else:
                hidden[-1] = False
        lines.append(_blank(line) if any(hidden) else line)
    return "".join(lines)


_C_PRINTERS = re.compile(
    r"^( *)def (?:view|stored|value|loads|guarded|wrapped|local|term|response|table_view|general_view|small_view"
    r"|specialized_view|_call|_single|kernel|_expression|_constant|next_byte)\(",
    re.MULTILINE,
)
_STRING = re.compile(r'f?"(?:[^"\\\n]|\\.)*"')


def _python_texts(source: str) -> str:
    """The texts of functions that print C, fields of f-strings as letters, and blanks elsewhere."""
    visible = list(_blank(source))
    for function in _C_PRINTERS.finditer(source):
        end = re.compile(rf"^ {{0,{len(function[1])}}}[^\s)]", re.MULTILINE).search(source, function.end())
        body = source[: end.start() if end else len(source)]
        for text in _STRING.finditer(body, function.end()):
            line = _line(source, text.start())
            if line.strip().startswith(('"""', "raise")) or "helpers" in line or "raise " in line:
                continue
            inner = text[0]
            if inner.startswith("f"):
                inner = re.sub(r"\{[^{}]*(?:\{[^{}]*\}[^{}]*)*\}", lambda found: "j" * len(found[0]), inner)
            if re.search(r"[<>+\-&|^~!]|\d", inner[1:]) is None and "uint" not in inner:
                continue
            quote = inner.index('"')
            for at, letter in enumerate(inner):
                if quote < at < len(inner) - 1:
                    visible[text.start() + at] = letter
    return "".join(visible)
