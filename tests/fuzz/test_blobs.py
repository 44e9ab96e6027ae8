# SPDX-License-Identifier: MIT
"""libFuzzer on the runtime, briefly: corpus and old findings are replayed, new blobs tried, and planted faults found."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from bitneat.native.data import runtime_dir
from tests.fuzz.blobs import CORPUS, REGRESSIONS, SANITIZERS, explore, fuzzer, read_blobs, seeded
from tests.fuzz.target import FindingError


@pytest.mark.parametrize("name", SANITIZERS)
def test_the_corpus_and_what_was_found_before_run_without_a_finding(tmp_path: Path, name: str) -> None:
    blobs = [*read_blobs(CORPUS), *read_blobs(REGRESSIONS)]
    for number, blob in enumerate(blobs):
        (tmp_path / str(number)).write_bytes(blob)
    done = subprocess.run([fuzzer(name), "-runs=0", tmp_path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    valid = int(done.stderr.split("valid blobs: ")[1].split()[0])
    assert 20 < valid < len(blobs)


@pytest.mark.parametrize("name", SANITIZERS)
def test_new_blobs_are_tried_without_a_finding(tmp_path: Path, name: str, budget: int) -> None:
    corpus = seeded(tmp_path / "corpus")
    assert explore(fuzzer(name), corpus, runs=30_000 * budget, seed=1, depth=2, longest=256) > 1000


PLANTED = {
    "a byte past the end": ("reader.c", "byte >= reader->size", "byte > reader->size"),
    "a link to a later slot": ("validate.c", "slot >= node->end ||", "slot > c->num_slots + 40U ||"),
    "an output that is no signal": ("validate.c", "slot_of(c, value) == c->num_slots", "0"),
    "lanes that differ": ("population.c", "observations[lane * num_inputs + i]", "observations[i]"),
}


@pytest.mark.parametrize("what", PLANTED)
def test_a_planted_fault_is_found(tmp_path: Path, what: str) -> None:
    name, right, wrong = PLANTED[what]
    runtime = shutil.copytree(runtime_dir(), tmp_path / "runtime")
    source = runtime / "src" / name
    assert right in source.read_text()
    source.write_text(source.read_text().replace(right, wrong))
    with pytest.raises(FindingError, match=r"blobs: [0-9a-f ]+: "):
        explore(fuzzer("blobs", runtime), seeded(tmp_path / "corpus"), runs=100_000, seed=1, depth=2, longest=256)
