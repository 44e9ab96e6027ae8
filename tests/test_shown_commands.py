# SPDX-License-Identifier: MIT
"""Every command that README, docs and examples show is run, or tests/shown/commands.toml says what is run instead, and why.

A page is a test: its commands run one after the other in one shell, in a folder that holds a copy of examples/ and what the table
lists as the page's inputs.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.shown import blocks, inputs, table
from tests.shown.blocks import Command
from tests.shown.output import difference
from tests.shown.table import Row, Table

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").rglob("*.md")])
}
SHOWN = {page: blocks.commands(page, text) for page, text in PAGES.items()}
RULES = table.read()


def to_run(page: str, rules: Table = RULES) -> list[tuple[Command, Row | None]]:
    """The commands of a page that are run, each with its row."""
    if page in rules.elsewhere:
        return []
    known = {one.text for other, found in SHOWN.items() if other not in rules.repeating for one in found}
    found = []
    for command in SHOWN[page]:
        row = rules.row(command)
        if page in rules.repeating and command.text in known:
            continue
        known.add(command.text)
        if row is None or row.run != "":
            found.append((command, row))
    return found


RUN = {page: found for page in PAGES if (found := to_run(page))}
LONG = [page for page, found in RUN.items() if any(row is not None and row.long for _, row in found)]


@pytest.mark.parametrize("page", RUN)
def test_the_commands_of_a_page_do_what_it_says(page: str, tmp_path: Path) -> None:
    run_page(page, [(command, row) for command, row in RUN[page] if row is None or not row.long], tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("page", LONG)
def test_the_commands_of_a_page_that_take_long_do_what_it_says(page: str, tmp_path: Path) -> None:
    run_page(page, RUN[page], tmp_path)


def run_page(page: str, work: Sequence[tuple[Command, Row | None]], folder: Path) -> None:
    """Run the commands in the page's folder, and judge each by its exit status and by what it prints."""
    missing = [name for name in RULES.needs.get(page, ()) if shutil.which(name) is None and not Path(name).is_file()]
    if missing:
        pytest.skip(f"{', '.join(missing)} is not there; tools/install-debian-tools.sh installs what it takes")
    here, said = folder / "here", folder / "said"
    said.mkdir()
    shutil.copytree(ROOT / "examples", here / "examples", ignore=shutil.ignore_patterns("build", "__pycache__"))
    for name, kind in RULES.inputs.get(page, {}).items():
        inputs.put(kind, here / name)
    script = []
    for i, (command, row) in enumerate(work):
        text = command.text if row is None or row.run is None else row.run
        expected = 0 if row is None else row.status
        script.append(
            f"{{ {text}\n}} >{said}/{i}.out 2>{said}/{i}.err </dev/null; s=$?; echo $s >{said}/{i}.status;"
            f" [ $s = {expected} ] || exit 99"
        )
    done = subprocess.run(
        ["bash", "--norc", "-c", "\n".join(script)],
        cwd=here,
        env=environment(folder),
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    for i, (command, row) in enumerate(work):
        assert (said / f"{i}.status").exists(), f"{command}: not reached: {done.stderr}"
        out, err = ((said / f"{i}.{stream}").read_text() for stream in ("out", "err"))
        expected = 0 if row is None else row.status
        status = int((said / f"{i}.status").read_text())
        assert status == expected, f"{command}: status {status}, expected {expected}\n{out}\n{err}"
        assert "Traceback" not in err, f"{command}\n{err}"
        if command.printed is not None:
            wrong = difference(command.printed, out.splitlines(), 0.0 if row is None else row.tolerance)
            assert wrong is None, f"{command}: shown, but not printed: {wrong}\n{out}"


def environment(folder: Path) -> dict[str, str]:
    """That of a user who has activated the environment that runs the tests."""
    home = folder / "home"
    home.mkdir()
    paths = [str(Path(sys.executable).parent), os.environ["PATH"]]
    return {**os.environ, "HOME": str(home), "PATH": os.pathsep.join(paths), "PYTHONPATH": str(ROOT), "COLUMNS": "132"}


def test_every_row_of_the_table_is_for_a_command_that_is_shown() -> None:
    assert table.stale(RULES, [command for found in SHOWN.values() for command in found]) == []


def test_a_row_for_what_no_page_shows_is_stale() -> None:
    shown = blocks.commands("a.md", "    bitneat size\n")
    rules = Table(
        (Row(("a.md", "b.md"), "bitneat size", "x"), Row(("*",), "bitneat verify", "x")),
        {"c.md": {}},
        frozenset(),
        {},
        {},
    )
    assert table.stale(rules, shown) == ["b.md: bitneat size", "*: bitneat verify", "c.md"]


@pytest.mark.parametrize("page", PAGES)
def test_no_line_that_looks_like_a_command_is_overlooked(page: str) -> None:
    lines = re.findall(r"^(?: {4})?(?:\$ )?((?:bitneat|make|pip|python3?|pytest) [^\n]*)$", PAGES[page], re.MULTILINE)
    found = {command.text for command in SHOWN[page]}
    in_prose = {line for line in lines if line not in PAGES[page].replace("\n    ", "\n") or not _in_block(page, line)}
    assert [line for line in lines if re.sub(r"\s+# .*$", "", line).strip() not in found and line not in in_prose] == []


def _in_block(page: str, line: str) -> bool:
    """Whether a line is indented, or between fences."""
    text = PAGES[page]
    at = re.search(rf"^(?: {{4}})?(?:\$ )?{re.escape(line)}$", text, re.MULTILINE)
    assert at is not None
    return at[0].startswith("    ") or text[: at.start()].count("\n```") % 2 == 1


def test_commands_are_found_in_all_kinds_of_blocks() -> None:
    page = """\
Prose with `bitneat size`.

    bitneat evolve   # a remark
    bitneat verify a \\
        --episodes 3

    import numpy

```sh
make
```

```python
bitneat = 1
```

    $ bitneat size x.pkl
    33 bytes
    ...
    $ cd y

    FAIL bitneat: a line of output
"""
    found = blocks.commands("a.md", page)
    assert [command.text for command in found] == [
        "bitneat evolve",
        "bitneat verify a --episodes 3",
        "make",
        "bitneat size x.pkl",
        "cd y",
    ]
    assert [command.printed for command in found] == [None, None, None, ("33 bytes", "..."), ()]
    assert [command.line for command in found] == [3, 4, 10, 17, 20]


@pytest.mark.parametrize(
    ("shown", "printed", "tolerance", "wrong"),
    [
        ("a  b", "a b", 0, None),
        ("a 10", "a 11", 0, "a 10"),
        ("a 10", "a 11", 0.2, None),
        ("a 10", "a 13", 0.2, "a 10"),
        ("1,000 steps", "1,100 steps", 0.1, None),
        ("a ... d", "a b c d", 0, None),
        ("a ... d", "a b c", 0, "a ... d"),
        ("...\nPASS", "x\ny\nPASS", 0, None),
        ("x\nPASS", "x\ny\nPASS", 0, "PASS"),
        ("x\n...", "x\ny\nPASS", 0, None),
        ("x", "x\ny", 0, "(nothing more, but 'y' was printed)"),
        ("x", "", 0, "x"),
    ],
)
def test_what_is_shown_is_compared_with_what_is_printed(
    shown: str, printed: str, tolerance: float, wrong: str | None
) -> None:
    assert difference(shown.split("\n"), printed.split("\n"), tolerance) == wrong


def test_a_page_whose_command_fails_or_prints_something_else_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for i, (text, row, message) in enumerate(
        [
            ("    bitneat size nothing.pkl\n", None, "status 2, expected 0"),
            ("    $ bitneat --version\n    bitneat 99\n", None, "shown, but not printed: bitneat 99"),
            ("    cd nowhere\n    bitneat --version\n", None, "status 1, expected 0"),
            ("    bitneat --version\n", Row(("*",), "bitneat --version", "x", status=2), "status 0, expected 2"),
        ]
    ):
        work = [(command, row) for command in blocks.commands("a.md", text)]
        folder = tmp_path / str(i)
        folder.mkdir()
        with pytest.raises(AssertionError, match=message):
            run_page("a.md", work, folder)
