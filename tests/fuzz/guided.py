# SPDX-License-Identifier: MIT
"""Has atheris look for files that reach new code: ``python -m tests.fuzz.guided champions FOLDER -runs=10000 CORPUS``.

The files that are read are written into FOLDER; the rest are libFuzzer's options.
"""

from __future__ import annotations

import random
import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["bitneat", "pickletools", "configparser"]):
    from tests.fuzz.files import KINDS, check
from tests.fuzz.mutate import mutate_bytes


def main() -> None:
    """The command line; atheris ends the process."""
    name, folder = sys.argv.pop(1), sys.argv.pop(1)
    kind = KINDS[name]

    def test(content: bytes) -> None:
        check(Path(folder, name), content, kind.read)

    def mutated(content: bytes, longest: int, seed: int) -> bytes:
        rng = random.Random(seed)
        choice = rng.random()
        if choice < 0.4:
            return kind.draw(rng)[:longest]
        if choice < 0.7:
            return mutate_bytes(content, rng)[:longest]
        return bytes(atheris.Mutate(content, longest))

    atheris.Setup(sys.argv, test, custom_mutator=mutated)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
