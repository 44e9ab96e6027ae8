# SPDX-License-Identifier: MIT
"""Dependencies point one way: cli -> (evolve, codegen, verify, report) -> controller, and neat-python stays in evolve."""

import ast
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import bitneat

PACKAGE = Path(bitneat.__file__).parent


@dataclass(frozen=True)
class Rule:
    """What ``part`` of bitneat may never reach, by any chain of imports; or all of bitneat that it may."""

    part: str
    never: tuple[str, ...] = ()
    only: tuple[str, ...] | None = None

    def forbids(self, module: str) -> bool:
        if self.only is not None and is_within(module, "bitneat") and module != "bitneat":
            return not any(is_within(module, allowed) for allowed in self.only)
        return any(is_within(module, forbidden) for forbidden in self.never)


RULES = (
    Rule("bitneat.controller", only=("bitneat.controller", "bitneat.errors", "bitneat.version")),
    Rule("bitneat.native", only=("bitneat.native", "bitneat.errors", "bitneat.version")),
    Rule("bitneat.files", only=("bitneat.files", "bitneat.errors", "bitneat.version")),
    Rule("bitneat.state", only=("bitneat.state", "bitneat.files", "bitneat.errors", "bitneat.version")),
    Rule("bitneat.codegen", never=("neat", "gymnasium", "bitneat.evolve", "bitneat.sim", "bitneat.cli")),
    Rule("bitneat.verify", never=("neat", "bitneat.evolve", "bitneat.cli")),
    Rule("bitneat.sim", never=("neat", "bitneat.evolve", "bitneat.codegen", "bitneat.verify", "bitneat.cli")),
    Rule(
        "bitneat.quantize",
        only=("bitneat.quantize", "bitneat.controller", "bitneat.network", "bitneat.errors", "bitneat.version"),
    ),
    Rule(
        "bitneat.policy", never=("neat", "gymnasium", "bitneat.evolve", "bitneat.sim", "bitneat.cli", "bitneat.codegen")
    ),
    Rule("bitneat.evolve", never=("bitneat.codegen", "bitneat.verify", "bitneat.baselines", "torch", "bitneat.cli")),
    Rule("bitneat.reproduce", never=("bitneat.codegen", "bitneat.verify", "bitneat.cli")),
    Rule("bitneat.baselines", never=("neat", "bitneat.codegen", "bitneat.verify", "bitneat.cli")),
    Rule("bitneat.doctor", never=("neat", "bitneat.evolve", "bitneat.cli")),
    Rule("bitneat.report", never=("bitneat.cli",)),
    Rule("bitneat.champion", never=("neat", "bitneat.evolve", "bitneat.cli")),
    Rule("bitneat.runtime", never=("neat", "bitneat.evolve", "bitneat.codegen", "bitneat.cli")),
)


def is_within(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


def modules_under(folder: Path) -> dict[str, Path]:
    """Every module of the package in ``folder``, by its full name."""
    names = {}
    for path in folder.rglob("*.py"):
        parts = ["bitneat", *path.relative_to(folder).with_suffix("").parts]
        names[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return names


def imports_of(name: str, path: Path, known: dict[str, Path]) -> Iterator[str]:
    """The modules that ``name`` imports, at its top or inside a function."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
                base = ".".join([*package[: len(package) - node.level + 1], *([node.module] if node.module else [])])
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names if f"{base}.{alias.name}" in known)


def violations(folder: Path) -> list[str]:
    """Each rule that is broken, with the chain of imports that breaks it."""
    known = modules_under(folder)
    graph = {name: sorted(set(imports_of(name, path, known))) for name, path in known.items()}
    found = []
    for rule in RULES:
        for start in (name for name in sorted(known) if is_within(name, rule.part)):
            chains = {start: [start]}
            waiting = [start]
            while waiting:
                module = waiting.pop(0)
                for imported in graph.get(module, ()):
                    if imported in chains:
                        continue
                    chains[imported] = [*chains[module], imported]
                    waiting.append(imported)
                    if rule.forbids(imported):
                        found.append(" -> ".join(chains[imported]))
    for name in known:
        if not is_within(name, "bitneat.cli") and name != "bitneat.__main__":
            found += [f"{name} -> {imported}" for imported in graph[name] if is_within(imported, "bitneat.cli")]
    return found


def test_no_part_reaches_what_it_must_not_know() -> None:
    assert violations(PACKAGE) == []


@pytest.mark.parametrize(
    ("module", "line", "chain"),
    [
        ("controller/planted.py", "from bitneat.files import read_capped", "controller.planted -> bitneat.files"),
        ("controller/planted.py", "from ..native import build", "controller.planted -> bitneat.native"),
        ("codegen/planted.py", "def late() -> None:\n    import neat.nn", "codegen.planted -> neat.nn"),
        ("codegen/planted.py", "from bitneat.evolve import x", "codegen.planted -> bitneat.evolve"),
        ("verify/planted.py", "import bitneat.elsewhere", "verify.planted -> bitneat.elsewhere -> neat"),
        ("evolve/planted.py", "from bitneat import codegen", "evolve.planted -> bitneat.codegen"),
        ("planted.py", "from bitneat.cli.main import main", "planted -> bitneat.cli.main"),
    ],
)
def test_the_check_finds_a_planted_import(module: str, line: str, chain: str, tmp_path: Path) -> None:
    copy = tmp_path / "bitneat"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / module).parent.mkdir(exist_ok=True)
    (copy / "codegen").mkdir(exist_ok=True)
    (copy / "codegen" / "__init__.py").touch()
    (copy / "elsewhere.py").write_text("import neat\n")
    (copy / module).write_text(f"{line}\n")
    assert any(chain in found for found in violations(copy))


@pytest.mark.parametrize(
    ("part", "absent"),
    [
        ("controller", ("neat", "gymnasium", "jinja2", "bitneat.files", "bitneat.native")),
        ("codegen", ("neat", "gymnasium", "bitneat.evolve", "bitneat.cli")),
        ("verify", ("neat", "bitneat.evolve", "bitneat.cli")),
        ("evolve", ("bitneat.codegen", "bitneat.verify", "bitneat.cli")),
        ("quantize", ("neat", "gymnasium", "bitneat.evolve", "bitneat.sim", "bitneat.files")),
        ("policy", ("neat", "gymnasium", "torch", "bitneat.evolve", "bitneat.sim")),
    ],
)
def test_a_fresh_interpreter_loads_no_more_than_the_rules_allow(part: str, absent: tuple[str, ...]) -> None:
    if not (PACKAGE / part).is_dir():
        pytest.skip(f"there is no bitneat.{part} yet")
    modules = [name for name in modules_under(PACKAGE) if is_within(name, f"bitneat.{part}")]
    code = f"import importlib, json, sys\nfor name in {modules!r}: importlib.import_module(name)\nprint(json.dumps([*sys.modules]))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = json.loads(done.stdout.splitlines()[-1])
    assert [name for name in absent if name in loaded] == []
