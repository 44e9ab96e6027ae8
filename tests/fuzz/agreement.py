# SPDX-License-Identifier: MIT
"""Blobs, as the C runtime and Python read them: both refuse, or both read the same controller.

Python asks for more, as docs/packed-format.md says: a blob in a form that `pack` does not write is valid for the C alone.
"""

from __future__ import annotations

import random
import struct
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from bitneat.controller import Reference
from bitneat.controller.packing import ENCODINGS, PackedFormatError, pack, unpack
from bitneat.native.compiler import host_compiler
from tests.compiled import SANITIZERS, compile_program
from tests.fuzz.blobs import CORPUS, read_blobs
from tests.fuzz.target import Batch, FindingError, Target, workshop
from tests.strategies import random_controller

BATCH = 5000
STEPS = 4
PROGRAM = r"""
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "bitneat/runtime.h"

/* Reads records of a 32-bit length and that many bytes; answers each with the number of its outputs in 16 bits, 0 for what is
 * not valid, and with the outputs of a few steps on inputs that every limit allows. All memory has the size that was asked for. */
int main(void)
{
    uint32_t size;
    while (fread(&size, 4, 1, stdin) == 1) {
        uint8_t *blob = malloc(size + (size == 0));
        struct bn_controller c;
        uint16_t outputs = 0;
        if (fread(blob, 1, size, stdin) != size) return 2;
        memset(&c, 0xA5, sizeof c);
        if (bn_open(&c, blob, size) == BN_OK) {
            int16_t *workspace = malloc(2U * c.workspace_length);
            int16_t *state = malloc(2U * c.num_state + 1U);
            int16_t *observation = malloc(2U * c.num_inputs);
            int16_t *action = malloc(2U * c.num_outputs);
            if (bn_validate(&c, workspace) == BN_OK) {
                outputs = c.num_outputs;
                fwrite(&outputs, 2, 1, stdout);
                bn_reset(&c, state);
                for (unsigned step = 0; step < STEPS; step++) {
                    for (unsigned i = 0; i < c.num_inputs; i++) {
                        observation[i] = (int16_t)((int)((7U * i + 5U * step) % 3U) - 1);
                    }
                    bn_step(&c, state, workspace, observation, action);
                    fwrite(action, 2, outputs, stdout);
                }
            }
            free(workspace); free(state); free(observation); free(action);
        }
        free(blob);
        if (outputs == 0) fwrite(&outputs, 2, 1, stdout);
    }
    return 0;
}
"""


def build(folder: Path) -> Path:
    """The program that has the runtime judge blobs, under sanitizers."""
    (folder / "main.c").write_text(PROGRAM)
    compile_program(folder / "main.c", folder / "main", ("-O1", f"-DSTEPS={STEPS}", *SANITIZERS))
    return folder / "main"


def runtime_outputs(checker: Path, blobs: list[bytes]) -> list[list[list[int]] | None]:
    """What the C makes of each blob: the outputs of each step, or None where it refuses.

    Raises:
        FindingError: if a sanitizer objects.
    """
    data = b"".join(struct.pack("<I", len(blob)) + blob for blob in blobs)
    done = subprocess.run([checker], input=data, capture_output=True, check=False)
    if done.returncode != 0:
        raise FindingError(f"agreement: {done.stderr.decode(errors='replace')[:3000]}")
    answers: list[list[list[int]] | None] = []
    at = 0
    while at < len(done.stdout):
        (count,) = struct.unpack_from("<H", done.stdout, at)
        values = list(struct.unpack_from(f"<{count * STEPS}h", done.stdout, at + 2))
        answers.append([values[step * count : (step + 1) * count] for step in range(STEPS)] if count else None)
        at += 2 + 2 * len(values)
    assert len(answers) == len(blobs)
    return answers


def compare(checker: Path, blobs: list[bytes]) -> int:
    """Have both judge the blobs; gives how many the C accepts.

    Raises:
        FindingError: where one reads what the other refuses, other than as a form that `pack` does not write, or both read it
            and their outputs differ.
    """
    count = 0
    for blob, outputs in zip(blobs, runtime_outputs(checker, blobs), strict=True):
        count += outputs is not None
        try:
            controller = unpack(blob)
        except PackedFormatError as error:
            if outputs is not None and "canonical" not in str(error):
                raise FindingError(f"agreement: {blob.hex()}: the C accepts it, Python says {error}") from None
            continue
        inputs = [[(7 * i + 5 * step) % 3 - 1 for i in range(len(controller.inputs))] for step in range(STEPS)]
        if outputs is None:
            raise FindingError(f"agreement: {blob.hex()}: Python reads it, the C refuses it")
        if outputs != Reference(controller).run(inputs):
            raise FindingError(f"agreement: {blob.hex()}: both read it, and its outputs differ")
    return count


def valid_blobs(seeds: range) -> list[bytes]:
    """The blobs of the controllers of those seeds, in every encoding."""
    blobs = []
    for seed in seeds:
        controller = random_controller(random.Random(seed), size="small" if seed % 4 else None)
        for encoding in ENCODINGS:
            try:
                blobs.append(pack(controller, encoding))
            except PackedFormatError:
                continue
    return blobs


def mutated(blob: bytes, rng: random.Random) -> bytes:
    """A blob with a few bits flipped, bytes replaced, cut off, added, or the tail of nothing but noise."""
    data = bytearray(blob)
    for _ in range(rng.randint(1, 3)):
        match rng.randrange(5):
            case 0 | 1:
                bit = rng.randrange(8 * len(data))
                data[bit >> 3] ^= 1 << (bit & 7)
            case 2:
                data[rng.randrange(len(data))] = rng.randrange(256)
            case 3:
                del data[rng.randrange(1, len(data) + 1) :]
            case _:
                data += rng.randbytes(rng.randint(1, 3))
    return bytes(data)


@cache
def _start() -> tuple[Path, list[bytes]]:
    blobs = [*read_blobs(CORPUS), *(blob for blob in valid_blobs(range(200)) if len(blob) < 150)]
    return build(Path(tempfile.mkdtemp(prefix="agreement-", dir=workshop()))), [blob for blob in blobs if blob]


def _run(number: int) -> Batch:
    checker, blobs = _start()
    rng = random.Random(f"agreement {number}")
    valid = compare(checker, [mutated(rng.choice(blobs), rng) for _ in range(BATCH)])
    return Batch(BATCH, {"valid": valid})


TARGET = Target(
    what="changed blobs to `bn_validate` and to `unpack`: both refuse, or both read the same, with the same outputs",
    unit="blobs",
    under="ASan, UBSan",
    tools=lambda: host_compiler().title,
    run=_run,
)
