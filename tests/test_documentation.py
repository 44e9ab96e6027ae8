# SPDX-License-Identifier: MIT
"""What the pages show exists: the files they link to, the commands and the make targets they name; and the site builds."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from bitneat.cli.main import COMMANDS
from tools import reference

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").rglob("*.md")])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_relative_link_leads_to_a_file(page: Path) -> None:
    targets = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    missing = [target for target in targets if "://" not in target and not (page.parent / target).exists()]
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_that_is_shown_exists(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    shown = set(re.findall(r"^ {4}(?:\$ )?bitneat ([a-z]+)", text, re.MULTILINE))
    assert shown <= set(COMMANDS)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"^ {4}(?:\$ )?make ([a-z][a-z-]*)", text, re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


def test_every_page_of_the_documentation_is_listed_in_the_index_and_on_the_site() -> None:
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    site = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = [str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md") if page.name != "README.md"]
    assert [page for page in pages if f"({page})" not in index] == []
    assert [page for page in pages if f": {page}\n" not in site] == []


@pytest.mark.parametrize("name", reference.PAGES)
def test_a_page_that_is_written_from_the_code_says_what_the_code_says(name: str) -> None:
    """If not: ``make reference``."""
    assert (reference.FOLDER / name).read_text(encoding="utf-8") == reference.PAGES[name]()


def test_the_reference_has_every_option_of_every_command() -> None:
    page = reference.cli_page()
    assert "--episodes" in page
    for name in COMMANDS:
        section = page.split(f"\n### bitneat {name}\n")[1].split("\n### ")[0]
        said = subprocess.run(
            [sys.executable, "-m", "bitneat", name, "--help"], capture_output=True, text=True, check=True
        ).stdout
        options = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", said.split("\nexample:")[0])) - {"--help"}
        assert [option for option in options if option not in section] == []


def test_the_site_builds_without_a_complaint_and_asks_no_other_host_for_anything(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1", "http_proxy": "http://127.0.0.1:9"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    pages = list(tmp_path.rglob("*.html"))
    assert len(pages) >= len(list((ROOT / "docs").rglob("*.md")))
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert re.findall(r"""(?:src=|<link[^>]*href=)["']?(?:https?:)?//[^"'> ]*""", text) == []
        targets = re.findall(r'(?:href|src)="([^"#?]+)"', text)
        missing = [target for target in targets if "://" not in target and not (page.parent / target).exists()]
        # The page for what is not there links from the root.
        assert page.name == "404.html" or missing == []
    assert "Encoder" in (tmp_path / "reference" / "api.html").read_text(encoding="utf-8")


FOR_DEVELOPERS = {"peers", "fuzz", "docs", "test", "dev"}


def test_every_extra_that_a_user_may_want_is_on_the_page_on_installing() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = set(project["optional-dependencies"]) - FOR_DEVELOPERS
    page = (ROOT / "docs" / "how-to" / "install.md").read_text(encoding="utf-8")
    assert sorted(extra for extra in extras if f"| `bitneat[{extra}]` |" not in page) == []


@pytest.mark.parametrize("page", [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))], ids=str)
def test_an_extra_that_is_installed_stands_in_quotes(page: Path) -> None:
    """A bare bracket is a pattern to zsh, which then finds no file."""
    assert not re.findall(r"pip install [^'\"\n]*bitneat\[", page.read_text(encoding="utf-8"))


def test_every_package_is_in_the_readmes_table_of_folders() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    packages = sorted(path.parent.name for path in (ROOT / "bitneat").glob("*/__init__.py"))
    assert [name for name in packages if f"`bitneat/{name}/`" not in readme] == []
