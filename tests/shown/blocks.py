# SPDX-License-Identifier: MIT
"""The commands that pages show: in indented or fenced blocks of shell, with or without a prompt.

In a block without prompts every line is a command. In one with ``$ `` before commands, what follows a command is what it prints.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

PROGRAMS = frozenset(
    ". avrdude bitneat cc cd cmp cp export gunzip make mkdir pip pytest python python3 tensorboard".split()
)  # a block is one of shell if one of its lines starts with one of these
_LANGUAGES = frozenset({"sh", "bash", "console", "shell"})
_SETTING = re.compile(r"^(?:[A-Z_]+=\S+ )+")
_REMARK = re.compile(r"\s+# .*$")


@dataclass(frozen=True)
class Command:
    """A command on a page.

    ``printed`` is what the page says it prints, a line each, None if the page does not say.
    """

    page: str
    line: int
    text: str
    printed: tuple[str, ...] | None = None

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: {self.text}"


def commands(page: str, text: str) -> list[Command]:
    """The commands of a page, in their order."""
    found: list[Command] = []
    for start, lines, language in _blocks(text):
        if language in _LANGUAGES or (language == "" and any(_starts_with_a_program(line) for line in lines)):
            found += _of_block(page, start, lines)
    return found


def _blocks(text: str) -> Iterator[tuple[int, list[str], str]]:
    """Every block of code: number of its first line, its lines, and its language, which is "" where none is named."""
    lines = text.split("\n")
    i, blank = 0, True
    while i < len(lines):
        fence = re.match(r"```(\w*)", lines[i])
        if fence:
            end = next((j for j in range(i + 1, len(lines)) if lines[j].startswith("```")), len(lines))
            yield i + 2, lines[i + 1 : end], fence[1]
            i = end
        elif blank and lines[i].startswith("    "):
            end = next((j for j in range(i, len(lines)) if not lines[j].startswith("    ")), len(lines))
            yield i + 1, [line[4:] for line in lines[i:end]], ""
            i = end - 1
        blank = not lines[i].strip() if i < len(lines) else True
        i += 1


def _starts_with_a_program(line: str) -> bool:
    words = _SETTING.sub("", line.removeprefix("$ ")).split()
    return bool(words) and (words[0] in PROGRAMS or words[0].startswith(("./", ".venv/", "tools/")))


def _of_block(page: str, start: int, lines: list[str]) -> Iterator[Command]:
    prompts = any(line.startswith("$ ") for line in lines)
    i = 0
    while i < len(lines):
        line, number = lines[i], start + i
        i += 1
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        text = line.removeprefix("$ ")
        while text.endswith("\\") and i < len(lines):
            text = f"{text[:-1].rstrip()} {lines[i].strip()}"
            i += 1
        printed = None
        if prompts:
            end = next((j for j in range(i, len(lines)) if lines[j].startswith("$ ")), len(lines))
            printed, i = tuple(lines[i:end]), end
        yield Command(page, number, _REMARK.sub("", text).strip(), printed)
