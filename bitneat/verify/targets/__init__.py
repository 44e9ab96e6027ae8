# SPDX-License-Identifier: MIT
"""The targets: where a controller's C is compiled, looked at and run. `docs/adding-a-target.md` adds one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from bitneat.codegen import Style
from bitneat.errors import BitneatError
from bitneat.verify.targets.base import ReadyTarget, Target
from bitneat.verify.targets.chips import CHIPS
from bitneat.verify.targets.host import HostTarget

__all__ = ["TARGETS", "HostTarget", "ReadyTarget", "Target", "select"]

_TARGETS: tuple[Target, ...] = (HostTarget("unrolled"), HostTarget("table"), *CHIPS)

TARGETS: dict[str, Target] = {target.name: target for target in _TARGETS}


def select(names: Sequence[str] | None, *, run: bool = True) -> list[ReadyTarget]:
    """The targets that are asked for, with their compilers.

    Args:
        names: from `TARGETS`, or the single name ``all``; None for the host and every other target whose compiler is there.
        run: whether code is to be run there, so that an emulator is needed too. Without names, a target that lacks only that
            is compiled for and measured all the same.

    Raises:
        BitneatError: if there is no name, one is unknown, or a target that was asked for cannot be served.
    """
    if names is None:
        found = [(target, target.toolchain()) for target in TARGETS.values()]
        return [
            ReadyTarget(target, toolchain, runs=run and target.missing_to_run() is None, asked=False)
            for target, toolchain in found
            if toolchain is not None
        ]
    if not names:
        raise BitneatError(f"--targets: names no target; the targets are {', '.join(TARGETS)}, or all")
    unknown = [name for name in names if name != "all" and name not in TARGETS]
    if unknown:
        raise BitneatError(f"--targets {unknown[0]}: no such target; the targets are {', '.join(TARGETS)}, or all")
    return [_ready(TARGETS[name], run) for name in (TARGETS if "all" in names else dict.fromkeys(names))]


def style_for(names: Sequence[str] | None) -> Style | Literal["auto"]:
    """The style to generate where there is no C yet: the only one that the targets run, or codegen's choice.

    Raises:
        BitneatError: as `select`.
    """
    targets = [] if names is None else [ready.target for ready in select(names)]
    styles = {style for target in targets for style in target.styles}
    return styles.pop() if len(styles) == 1 else "auto"


def _ready(target: Target, run: bool) -> ReadyTarget:
    toolchain = target.toolchain()
    if toolchain is None:
        raise BitneatError(f"--targets {target.name}: its tools are missing; install {target.needs}")
    missing = target.missing_to_run() if run else None
    if missing is not None:
        raise BitneatError(f"--targets {target.name}: its tools are missing; install {missing}")
    return ReadyTarget(target, toolchain, runs=run, asked=True)
