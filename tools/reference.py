# SPDX-License-Identifier: MIT
"""``python -m tools.reference``: writes the pages of docs/reference that say what the code says.

``cli.md`` comes from the parsers of the sub-commands, ``configuration.md`` from the schema and the presets of the search.
A test holds the committed pages to them.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from bitneat.cli.main import COMMANDS, GROUPS, build_parser, load
from bitneat.evolve.config import SCHEMA, Entry, Real, Series, Whole, Words, preset_names
from bitneat.evolve.config import load as load_config
from bitneat.files import write_atomic

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "reference"

_WRITTEN = "<!-- Written by python -m tools.reference; do not edit. -->"
_REMARK = re.compile(r" {3,}(?=\S)")
_PAGE_NAME = re.compile(r"\bdocs/([a-z/-]+\.md)")


def cli_page() -> str:
    """The command line, by what the sub-commands are for."""
    parser = build_parser(tuple(COMMANDS))
    assert parser._subparsers is not None
    parsers: Mapping[str, argparse.ArgumentParser] = parser._subparsers._group_actions[0].choices  # type: ignore[assignment]
    parts = [
        "# Command line",
        _WRITTEN,
        "`bitneat --help` lists the commands, `bitneat COMMAND --help` or `bitneat help COMMAND` says what is below."
        " The [packages and extras](../how-to/install.md) that a command needs are named by `bitneat doctor`.",
        "| exit status | |\n|---|---|\n| 0 | good |\n| 1 | what was to be checked does not hold |\n"
        "| 2 | bad input or arguments, or a missing tool: one line on standard error |\n"
        "| 70 | internal error, a fault of bitneat's: one line on standard error; with `BITNEAT_TRACEBACK=1`"
        " in the environment where it came from, too |\n| 130 | interrupted |\n"
        "| 141 | the reader of standard output has gone away, as `head` does |\n| 143 | terminated |",
    ]
    for title, names in GROUPS.items():
        parts.append(f"## {title.capitalize()}")
        for name in names:
            parts += _command(name, parsers[name])
    return "\n\n".join(parts) + "\n"


def _command(name: str, parser: argparse.ArgumentParser) -> Iterator[str]:
    """One sub-command: what it does, its arguments by group, examples, exit status, files."""
    command = load(name)
    yield f"### bitneat {name}"
    yield f"{command.HELP[0].upper()}{command.HELP[1:]}."
    yield _PAGE_NAME.sub(r"[\1](../\1)", " ".join(command.DESCRIPTION.split()))
    yield from _tables(parser)
    yield _examples(command.EXAMPLE)
    yield from _nested(name, parser)
    if hasattr(command, "STATUS"):
        yield "Exit status: " + "; ".join(
            f"{line.strip()[0]}, {line.strip()[1:].strip()}" for line in command.STATUS.splitlines()
        )
    yield "Files: " + "; ".join(_files(command.FILES)) + "."


def _tables(parser: argparse.ArgumentParser) -> Iterator[str]:
    """The arguments, a table for each group."""
    for group in parser._action_groups:
        shown = (action for action in group._group_actions if not isinstance(action, argparse._SubParsersAction))
        rows = [_argument(parser, action) for action in shown if action.dest != "help"]
        if rows:
            title = {"positional arguments": "arguments"}.get(group.title or "", group.title)
            yield "\n".join([f"| {title} | |", "|---|---|", *rows])


def _nested(name: str, parser: argparse.ArgumentParser) -> Iterator[str]:
    """The sub-commands that a sub-command has itself."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word, inner in action.choices.items():
                yield f"#### bitneat {name} {word}"
                if inner.description:
                    yield f"{inner.description[0].upper()}{inner.description[1:]}."
                yield from _tables(inner)
                if inner.epilog and "example:\n" in inner.epilog:
                    yield _examples(inner.epilog.partition("example:\n")[2])


def _argument(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    """A row of a table: how it is given, and what it means."""
    if action.choices is not None:
        value = "{" + ",".join(map(str, action.choices)) + "}" if action.metavar is None else str(action.metavar)
    else:
        value = str(action.metavar or action.dest)
    takes = "" if action.nargs == 0 else f" {value}"
    given = ", ".join(action.option_strings) + takes if action.option_strings else value
    meaning = _PAGE_NAME.sub(r"[\1](../\1)", parser._get_formatter()._expand_help(action))
    return f"| {_cell(f'`{given}`')} | {_cell(meaning)} |"


def _examples(text: str) -> str:
    """The examples as a block of shell commands, what is remarked on them as comments."""
    lines = [_REMARK.split(line.strip(), maxsplit=1) for line in text.splitlines()]
    width = max(len(command) for command, *_ in lines)
    return "\n".join(
        f"    {command:{width}}   # {remark[0]}" if remark else f"    {command}" for command, *remark in lines
    )


def _files(text: str) -> list[str]:
    """The lines of ``FILES``, continuations joined to what they continue."""
    lines: list[str] = []
    for line in text.splitlines():
        if line.startswith("    ") and lines:
            lines[-1] += f" {line.strip()}"
        else:
            lines.append(_REMARK.sub(" ", line.strip(), count=1) if "  " in line.strip() else line.strip())
    return [
        re.sub(r"^((?:[A-Z][\w./]*|champion\.pkl)(?:, [A-Z][\w./]*)*)", r"`\1`", re.sub(r" {2,}", " ", line))
        for line in lines
    ]


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def configuration_page() -> str:
    """Every key of a configuration: what it may be, its default, and what the presets make of it."""
    presets = {name: load_config(name) for name in preset_names()}
    parts = [
        "# Configuration keys",
        _WRITTEN,
        "A configuration is an ini file; every key is optional, and unknown sections, unknown keys and values out of range are"
        " refused. [evolve.md](../evolve.md#the-other-settings) says what the keys mean, `RUN/config.ini` has those of a run."
        f" `--config` takes a file or one of the presets: {', '.join(f'`{name}`' for name in presets)}. The last column has the"
        " presets that differ from the default.",
    ]
    for section, entries in SCHEMA.items():
        rows = []
        for key, entry in entries.items():
            default = _shown(entry, entry.parse(_default_text(entry)))
            differing: dict[str, list[str]] = {}
            for name, config in presets.items():
                if section in config.text and f"[{section}]" in config.text:
                    value = _shown(entry, config[section][key])
                    if value != default:
                        differing.setdefault(value, []).append(name)
            told = "; ".join(f"{value}: {', '.join(names)}" for value, names in differing.items())
            rows.append(f"| `{key}` | {_range(entry)} | {default} | {told} |")
        parts += [f"## [{section}]", "\n".join(["| key | values | default | presets |", "|---|---|---|---|", *rows])]
    return "\n\n".join(parts) + "\n"


def _default_text(entry: Entry) -> str:
    if isinstance(entry, Words):
        return " ".join(entry.default)
    if isinstance(entry, Series):
        return " ".join(f"{value:g}" for value in entry.default) or "auto"
    return "none" if math.isnan(entry.default) else repr(entry.default)


def _shown(entry: Entry, value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(word if isinstance(word, str) else f"{word:g}" for word in value) or "auto"
    if isinstance(value, float):
        return "none" if math.isnan(value) else f"{value:g}"
    return str(value)


def _range(entry: Entry) -> str:
    if isinstance(entry, Words):
        return f"{'one' if entry.single else 'some'} of {', '.join(entry.options)}"
    span = f"{entry.low:g} to {entry.high:g}" if isinstance(entry, Real | Series) else f"{entry.low} to {entry.high}"
    if isinstance(entry, Series):
        kind = "integers" if entry.whole else "numbers"
        order = {0: "", 1: ", rising", -1: ", falling"}[entry.rising]
        return f"{kind}, {span}{order}{', or auto' if entry.auto else ''}"
    return f"{'integer' if isinstance(entry, Whole) else 'number'}, {span}"


PAGES: Mapping[str, Callable[[], str]] = {"cli.md": cli_page, "configuration.md": configuration_page}


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the pages."""
    argparse.ArgumentParser(prog="python -m tools.reference", description=__doc__).parse_args(arguments)
    for name, page in PAGES.items():
        write_atomic(FOLDER / name, page().encode())
        print(f"wrote docs/reference/{name}")


if __name__ == "__main__":
    main()
