# SPDX-License-Identifier: MIT
"""Which Python packages are installed. Imports none of them, so that it can be said which is missing."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, requires

from bitneat.doctor.finding import Finding
from bitneat.version import installed_version

_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[[^]]*\])?[^;]*(?:;.*extra == ['\"]([^'\"]+)['\"])?")
_OURS = ("test", "dev")
"""Extras for work on bitneat itself."""

_EXTRAS = {
    "plot": "bitneat plot, figures of bitneat reproduce",
    "baselines": "bitneat baseline",
    "bench": "EnvPool in bitneat bench sim",
    "prove": "bitneat prove",
    "peers": "python -m benchmarks.peers, from a checkout",
    "fuzz": "python -m tests.fuzz.guided, from a checkout",
    "docs": "make docs, from a checkout",
    "render": "bitneat render",
    "tensorboard": "bitneat evolve --tensorboard",
    "cluster": "bitneat evolve --evaluator ray",
}


def packages() -> list[Finding]:
    """The Python packages that bitneat always needs, in one finding."""
    wanted = _requirements().get("", [])
    missing = [name for name in wanted if installed_version(name) is None]
    if not wanted:  # run from a checkout that is not installed
        return [Finding("Python", "packages", "missing", "bitneat is not installed", "everything", "pip install .")]
    if missing:
        remedy = f"pip install {' '.join(missing)}"
        return [Finding("Python", "packages", "missing", ", ".join(missing), "everything", remedy, required=True)]
    shown = ("neat-python", "gymnasium", "numpy")
    detail = ", ".join([f"all {len(wanted)}", *(f"{name} {installed_version(name)}" for name in shown)])
    return [Finding("Python", "packages", "found", detail, "everything", required=True)]


def extras() -> list[Finding]:
    """The optional dependencies, by the name of their extra."""
    found = []
    for extra, names in sorted(_requirements().items()):
        if not extra or extra in _OURS:
            continue
        missing = [name for name in names if installed_version(name) is None]
        versions = ", ".join(f"{name} {installed_version(name)}" for name in names if name not in missing)
        detail = f"without {', '.join(missing)}" if missing else versions
        remedy = f"pip install 'bitneat[{extra}]'" if missing else ""
        enables = _EXTRAS.get(extra, f"what bitneat[{extra}] is for")
        found.append(Finding("extras", extra, "missing" if missing else "found", detail, enables, remedy))
    return found


def _requirements() -> dict[str, list[str]]:
    """The distributions that bitneat names, by extra; "" for those that it always needs."""
    try:
        lines = requires("bitneat") or []
    except PackageNotFoundError:
        return {}
    named: dict[str, list[str]] = {}
    for line in lines:
        match = _REQUIREMENT.match(line)
        if match and match[1] != "bitneat":
            named.setdefault(match[2] or "", []).append(match[1])
    return named
