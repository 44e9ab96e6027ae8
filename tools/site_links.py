# SPDX-License-Identifier: MIT
"""A hook of mkdocs: the pages link to files of the repository, and on the site these links must lead somewhere, too.

On a plain git host a link such as ``../examples/champions/README.md`` or ``../bitneat/network.py`` works as it is. The site
holds only what is in docs/, so for the site the READMEs of examples become pages under ``examples/``, other files are copied
to ``files/``, links to folders become plain text, and every link is rewritten to where its file is on the site.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"

_LINK = re.compile(r"(?P<image>!?)\[(?P<text>(?:[^\[\]]|\[[^\[\]]*\])*)\]\((?P<target>[^)\s#]*)(?P<anchor>#[^)\s]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and files that pages of docs/ link to, and those that these link to."""
    waiting = [DOCS / file.src_uri for file in files.documentation_pages()]
    seen = set(waiting)
    while waiting:
        page = waiting.pop()
        for linked in _linked(page):
            if linked in seen or linked.is_relative_to(DOCS):
                continue
            seen.add(linked)
            # Not in the navigation on purpose, which strict mode would complain of.
            file = File.generated(config, _uri(linked), abs_src_path=str(linked), inclusion=InclusionLevel.NOT_IN_NAV)
            files.append(file)
            if linked.suffix == ".md":
                waiting.append(linked)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Rewrite the links of a page to where the files are on the site."""
    del config, files
    assert page.file.abs_src_path is not None
    source, here = Path(page.file.abs_src_path), posixpath.dirname(page.file.src_uri)

    def rewritten(link: re.Match[str]) -> str:
        found = _resolve(source, link["target"])
        if found is None:
            return link[0]
        if found.is_dir():
            return link["text"]
        target = posixpath.relpath(_uri(found), here or ".")
        return f"{link['image']}[{link['text']}]({target}{link['anchor'] or ''})"

    return _outside_code(markdown, lambda text: _LINK.sub(rewritten, text))


def _linked(page: Path) -> list[Path]:
    """The files of the repository that a page links to."""
    found: list[Path] = []

    def note(text: str) -> str:
        targets = (_resolve(page, link["target"]) for link in _LINK.finditer(text))
        found.extend(target for target in targets if target is not None and target.is_file())
        return text

    _outside_code(page.read_text(encoding="utf-8"), note)
    return found


def _resolve(page: Path, target: str) -> Path | None:
    """The file or folder that a relative link of a page leads to; None for any other link."""
    if not target or "://" in target or target.startswith("/"):
        return None
    found = (page.parent / target).resolve()
    return found if found.exists() and found.is_relative_to(ROOT) else None


def _uri(path: Path) -> str:
    """Where a file of the repository is on the site."""
    if path.is_relative_to(DOCS):
        return path.relative_to(DOCS).as_posix()
    inside = path.relative_to(ROOT).as_posix()
    return inside if path.suffix == ".md" else f"files/{inside}"


def _outside_code(markdown: str, change: Any) -> str:
    """The text with a change made everywhere but in fenced and indented blocks."""
    lines, fenced = [], False
    for line in markdown.split("\n"):
        if line.lstrip().startswith("```"):
            fenced = not fenced
        code = fenced or line.startswith("    ")
        lines.append(line if code else change(line))
    return "\n".join(lines)
