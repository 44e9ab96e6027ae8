# SPDX-License-Identifier: MIT
"""What of bitneat works on this machine: which tools are there, and whether a controller comes out right."""

from __future__ import annotations

from collections.abc import Iterator

from bitneat.doctor.finding import Finding, State
from bitneat.doctor.installed import extras, packages

__all__ = ["Finding", "State", "findings"]


def findings(*, trials: bool = True) -> Iterator[Finding]:
    """Look at everything, one thing after the other; where Python packages are missing, at nothing that needs them.

    Args:
        trials: whether to build and run, too, and not only to look what is there.
    """
    needed = packages()
    yield from needed
    yield from extras()
    if any(one.blocks for one in needed):
        return
    from bitneat.doctor import tools

    for look in (tools.compilers, tools.emulators, tools.targets):
        yield from look()
    if not trials:
        return
    from bitneat.doctor import selftest

    yield from selftest.native_builds()
    yield from selftest.selftest()
