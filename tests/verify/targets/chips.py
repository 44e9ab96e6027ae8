# SPDX-License-Identifier: MIT
"""Chips by name, and C on them."""

from bitneat.verify.cfile import CFile
from bitneat.verify.machine import Toolchain
from bitneat.verify.targets import select
from bitneat.verify.targets.chip import Chip
from bitneat.verify.targets.chips import CHIPS
from bitneat.verify.targets.emulated import EmulatedC

BY_NAME = {one.name: one for one in CHIPS}


def ready(name: str) -> tuple[Chip, Toolchain]:
    (one,) = select([name])
    return BY_NAME[name], one.toolchain


def emulated(name: str, code: CFile, entry: str = "step") -> EmulatedC:
    target, toolchain = ready(name)
    return target.implementation(code, toolchain, entry)
