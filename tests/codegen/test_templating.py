# SPDX-License-Identifier: MIT
"""Compiled templates are kept, and a damaged one is compiled again."""

from pathlib import Path
from typing import Any

import pytest

from bitneat.codegen import templating

TEMPLATE = "package/LICENSE.j2"


def code() -> tuple[object, ...]:
    """Of a template, as an environment that was made anew has it."""
    templating.environment.cache_clear()
    return templating.environment().get_template(TEMPLATE).root_render_func.__code__.co_consts


def test_a_kept_template_is_used_only_if_it_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(templating, "cache_dir", lambda: tmp_path)
    try:
        whole = code()
        (kept,) = tmp_path.iterdir()
        content = kept.read_bytes()
        compiled: list[str] = []
        real = templating.jinja2.Environment.compile

        def count(self: Any, source: str, *arguments: Any, **options: Any) -> Any:
            compiled.append(source)
            return real(self, source, *arguments, **options)

        monkeypatch.setattr(templating.jinja2.Environment, "compile", count)
        assert code() == whole
        assert not compiled
        for bad in (b"", content[:40], content[:-1], content[:200] + bytes([content[200] ^ 1]) + content[201:]):
            kept.write_bytes(bad)
            compiled.clear()
            assert code() == whole
            assert len(compiled) == 1
            assert kept.read_bytes() == content
    finally:
        templating.environment.cache_clear()
