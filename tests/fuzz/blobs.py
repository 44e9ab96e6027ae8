# SPDX-License-Identifier: MIT
"""``bn_open``, ``bn_validate`` and the interpreter on any bytes: libFuzzer drives `blob.c` under clang's sanitizers."""

from __future__ import annotations

import random
import re
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from bitneat.controller.packing import pack
from bitneat.native.compiler import identify
from bitneat.native.data import runtime_dir
from tests.compiled import RUNTIME_SOURCES, WARNINGS, encodings_of
from tests.fuzz.target import WORK, Batch, FindingError, Target, workshop
from tests.strategies import random_controller

HERE = Path(__file__).parent
CORPUS = HERE / "corpus" / "blobs.txt"
REGRESSIONS = HERE / "regressions" / "blobs.txt"
RUNS = 250_000
SANITIZERS = {"blobs": "address,undefined", "blobs-memory": "memory"}
LIMITS = ("-timeout=10", "-rss_limit_mb=1024", "-malloc_limit_mb=64")


def read_blobs(path: Path) -> list[bytes]:
    """The blobs of a file with one in each line, in hexadecimal; what follows a # is a remark."""
    lines = (line.partition("#")[0].strip() for line in path.read_text().splitlines())
    return [bytes.fromhex(line) for line in lines if line]


def packed_blobs(seeds: range, longest: int = 250) -> list[bytes]:
    """The blobs of random controllers in every encoding, of those seeds and up to that length."""
    blobs = []
    for seed in seeds:
        controller = random_controller(random.Random(seed), size="small" if seed % 4 else "medium")
        blobs += [pack(controller, encoding) for encoding in encodings_of(controller)]
    return [blob for blob in blobs if len(blob) <= longest]


def clang() -> str:
    """The command of clang; libFuzzer comes with it.

    Raises:
        AssertionError: if it is not there.
    """
    command = shutil.which("clang")
    assert command, "clang is missing: run tools/install-debian-tools.sh"
    return command


@cache
def fuzzer(name: str, runtime: Path | None = None) -> Path:
    """The fuzzer with the sanitizers that ``SANITIZERS`` has for its name; of another copy of the runtime if one is given."""
    folder = Path(tempfile.mkdtemp(prefix=f"{name}-", dir=workshop()))
    sources = runtime or runtime_dir()
    flags = [f"-fsanitize=fuzzer,{SANITIZERS[name]}", "-fno-sanitize-recover=all", "-O1", "-g"]
    files = [HERE / "blob.c", *(sources / "src" / f"{source}.c" for source in RUNTIME_SOURCES)]
    command = [clang(), "-std=c99", *WARNINGS, *flags, f"-I{sources / 'include'}", *map(str, files)]
    done = subprocess.run([*command, "-o", str(folder / "fuzz")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:3000]
    return folder / "fuzz"


def explore(program: Path, corpus: Path, *, runs: int, seed: int, depth: int, longest: int) -> int:
    """Let libFuzzer try as many inputs, adding to the corpus those that reach something new; gives how many were valid.

    Raises:
        FindingError: with the input, in hexadecimal, at which it crashed, ran for too long, or used too much memory.
    """
    options = [f"-runs={runs}", f"-seed={seed}", f"-mutate_depth={depth}", f"-max_len={longest}", *LIMITS]
    with tempfile.TemporaryDirectory(prefix="found-", dir=workshop()) as found:
        done = subprocess.run(
            [program, *options, f"-artifact_prefix={found}/", corpus],
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
        if done.returncode != 0:
            inputs = [path.read_bytes().hex() for path in Path(found).iterdir()]
            said = re.findall(r"^.*(?:ERROR|runtime error).*$", done.stderr, re.MULTILINE)
            raise FindingError(f"blobs: {' '.join(inputs)}: {'; '.join(said) or done.stderr[-500:]}")
    valid = re.search(r"^valid blobs: (\d+)$", done.stderr, re.MULTILINE)
    assert valid, done.stderr[-500:]
    return int(valid.group(1))


def seeded(folder: Path) -> Path:
    """A folder for libFuzzer's corpus, with the committed one and blobs of random controllers in it."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, blob in enumerate([*read_blobs(CORPUS), *packed_blobs(range(60))]):
        (folder / f"seed-{number}").write_bytes(blob)
    return folder


def _batch(name: str, number: int) -> Batch:
    corpus = WORK / f"{name}-corpus"
    if not corpus.exists():
        seeded(corpus)
    longest = 2048 if number % 10 == 9 else 256
    valid = explore(fuzzer(name), corpus, runs=RUNS, seed=number + 1, depth=1 + number % 5, longest=longest)
    return Batch(RUNS, {"valid": valid})


def _target(name: str, under: str) -> Target:
    return Target(
        what="any bytes to `bn_open` and `bn_validate`; what is valid is run, step by step and by lanes, which must agree",
        unit="blobs",
        under=under,
        tools=lambda: getattr(identify([clang()]), "title", ""),
        run=lambda number: _batch(name, number),
        explores=True,
    )


TARGETS = {
    "blobs": _target("blobs", "ASan, UBSan"),
    "blobs-memory": _target("blobs-memory", "MSan"),
}


def minimized(name: str, longest: int = 64) -> list[bytes]:
    """The fewest and shortest blobs of the explored corpus that reach all that it reaches."""
    with tempfile.TemporaryDirectory(prefix="merged-", dir=workshop()) as merged:
        options = ["-merge=1", f"-max_len={longest}", *LIMITS]
        subprocess.run([fuzzer(name), *options, merged, WORK / f"{name}-corpus"], capture_output=True, check=True)
        return sorted((path.read_bytes() for path in Path(merged).iterdir()), key=lambda blob: (len(blob), blob))


def write_corpus() -> None:
    """Write the committed corpus anew, from what the fuzzer `blobs` has explored."""
    head = "# Blobs that together reach all of the runtime that fuzzing has reached: python -m tests.fuzz corpus"
    CORPUS.write_text("\n".join([head, *(blob.hex() for blob in minimized("blobs"))]) + "\n")
