# SPDX-License-Identifier: MIT
"""C as coloured HTML."""

from __future__ import annotations

import re

from markupsafe import Markup, escape

_TOKENS = re.compile(
    r"(?P<comment>/\*.*?\*/|//[^\n]*)"
    r'|(?P<string>"(?:\\.|[^"\\\n])*")'
    r"|(?P<directive>^[ \t]*#[a-z]+)"
    r"|(?P<number>\b(?:0x[0-9a-fA-F]+|\d+)[uUlL]*\b)"
    r"|(?P<type>\b(?:u?int(?:8|16|32)_t|int|unsigned|void|const|static|inline|struct|char|long|volatile)\b)"
    r"|(?P<keyword>\b(?:if|else|for|while|do|return|break|continue|switch|case|default|sizeof|extern)\b)",
    re.MULTILINE | re.DOTALL,
)


def highlighted(source: str) -> Markup:
    """The source with comments, numbers, types and so on in spans of those classes; everything is escaped."""
    parts, at = [], 0
    for token in _TOKENS.finditer(source):
        parts.append(escape(source[at : token.start()]))
        parts.append(Markup('<span class="c-{}">{}</span>').format(token.lastgroup, token[0]))
        at = token.end()
    return Markup("").join([*parts, escape(source[at:])])
