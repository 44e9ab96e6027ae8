# SPDX-License-Identifier: MIT
"""``bn_open`` and ``bn_validate`` take any bytes: what they accept runs under the sanitizers, and Python reads it the same."""

from __future__ import annotations

import random
import struct
import subprocess
from pathlib import Path

import pytest

from bitneat.controller.packing import ENCODINGS, PackedFormatError, pack, unpack
from tests.compiled import SANITIZERS, compile_program
from tests.strategies import random_controller

PROGRAM = r"""
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "bitneat/runtime.h"

/* Reads records of a 32-bit length and that many bytes; answers with a status byte for each. What is valid is run, in
 * memory of exactly the size that it asked for. */
int main(void)
{
    uint32_t size;
    while (fread(&size, 4, 1, stdin) == 1) {
        uint8_t *blob = malloc(size + (size == 0));
        struct bn_controller c;
        if (fread(blob, 1, size, stdin) != size) return 2;
        memset(&c, 0xA5, sizeof c);
        enum bn_status status = bn_open(&c, blob, size);
        if (status == BN_OK) {
            int16_t *workspace = malloc(2U * c.workspace_length);
            int16_t *state = malloc(2U * c.num_state + 1U);
            int16_t *observation = malloc(2U * c.num_inputs);
            int16_t *action = malloc(2U * c.num_outputs);
            status = bn_validate(&c, workspace);
            if (status == BN_OK) {
                bn_reset(&c, state);
                for (int step = 0; step < 3; step++) {
                    for (unsigned i = 0; i < c.num_inputs; i++) {
                        observation[i] = (int16_t)(step == 0 ? 32767 : step == 1 ? -32767 : 5);
                    }
                    bn_step(&c, state, workspace, observation, action);
                }
            }
            free(workspace); free(state); free(observation); free(action);
        }
        free(blob);
        putchar(status == BN_OK ? 'y' : 'n');
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def checker(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("validate")
    (folder / "main.c").write_text(PROGRAM)
    compile_program(folder / "main.c", folder / "main", ("-O1", *SANITIZERS))
    return folder / "main"


def accepted(checker: Path, blobs: list[bytes]) -> list[bool]:
    """What the C says of each blob."""
    data = b"".join(struct.pack("<I", len(blob)) + blob for blob in blobs)
    done = subprocess.run([checker], input=data, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode(errors="replace")[:3000]
    assert len(done.stdout) == len(blobs)
    return [letter == ord("y") for letter in done.stdout]


def valid_blobs(seeds: range) -> list[bytes]:
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


def assert_agreement(checker: Path, blobs: list[bytes]) -> int:
    """Where Python reads a blob C accepts it; what C accepts Python reads, or calls a form that `pack` does not write."""
    count = 0
    for blob, good in zip(blobs, accepted(checker, blobs), strict=True):
        count += good
        try:
            unpack(blob)
        except PackedFormatError as error:
            assert not good or "canonical" in str(error), f"{blob.hex()}: C accepts it, Python says {error}"
        else:
            assert good, f"{blob.hex()}: Python reads it, C refuses it"
    return count


def test_every_blob_that_is_packed_is_valid(checker: Path) -> None:
    blobs = valid_blobs(range(200))
    assert assert_agreement(checker, blobs) == len(blobs)


def test_changed_blobs_are_judged_alike_and_what_is_accepted_runs(checker: Path, budget: int) -> None:
    rng = random.Random(20)
    blobs = valid_blobs(range(100))
    changed = [mutated(rng.choice(blobs), rng) for _ in range(4000 * budget)]
    count = assert_agreement(checker, changed)
    assert 0 < count < len(changed)


def test_noise_is_judged_alike(checker: Path, budget: int) -> None:
    rng = random.Random(21)
    noise = [bytes([rng.randrange(5) << 3 | 1]) + rng.randbytes(rng.randint(0, 40)) for _ in range(4000 * budget)]
    assert_agreement(checker, noise)
