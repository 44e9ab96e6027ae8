# SPDX-License-Identifier: MIT
"""The same champion, C, sizes and report to the byte, whatever surrounds the process that makes them.

Each run is a process of its own in a folder of its own. What is varied: the seed of Python's hashes, locale, time zone, umask,
working folder, width of the terminal, home folder and, in the long tests, the version of Python. Sizes are measured with two
compilers, gcc and ziglang's clang.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.small import small_search

ROOT = Path(__file__).resolve().parents[1]

CONFIG = small_search(3, 16, "[BitGenome]\nmutate_bias = 1\nmutate_delay = 0.5\n")

DRIVER = """
import json, os, sys
from bitneat.cli.main import main
os.umask(int(sys.argv[1]))
for path, arguments in json.loads(sys.argv[2]):
    if path is not None:
        os.environ["PATH"] = path
    status = main(arguments)
    if status:
        sys.exit(f"{arguments}: status {status}")
"""

EVOLVE = ["evolve", "--env", "CartPole-v1", "--config", "small.ini", "--seed", "3", "--workers", "1", "-o", "run"]
CODEGEN = ["codegen", "run/champion.pkl", "-o", "walker.c", "--selftest"]
REPORT = [
    "report",
    "run/champion.pkl",
    "-o",
    "report.html",
    "--targets",
    "host-unrolled,host-table",
    "--episodes",
    "1",
    "--seeds",
    "4",
]
COMMANDS = (EVOLVE, CODEGEN, REPORT)


@dataclass(frozen=True)
class Surroundings:
    """What must not matter."""

    hash_seed: str = "0"
    locale: str = "C"
    zone: str = "UTC"
    umask: int = 0o022
    folder: str = "here"
    columns: str = "80"

    def environment(self, home: Path) -> dict[str, str]:
        """The variables of the process."""
        return {
            "PATH": os.environ["PATH"],
            "PYTHONPATH": str(ROOT),
            "BITNEAT_CACHE_DIR": os.environ["BITNEAT_CACHE_DIR"],
            "HOME": str(home),
            "PYTHONHASHSEED": self.hash_seed,
            "LC_ALL": self.locale,
            "TZ": self.zone,
            "COLUMNS": self.columns,
        }


VARIED = (
    Surroundings("1", "C.UTF-8", "Pacific/Kiritimati", 0o077, "some where else/ünder", "40"),
    Surroundings("4294967295", "de_DE.UTF-8", "America/St_Johns", 0o002, "x" * 100, "200"),
    Surroundings("random", "tr_TR.UTF-8", "XYZ+12:34:56", 0o000, "a", "80"),
)


def drawn(number: int) -> Surroundings:
    """Surroundings number ``number``."""
    rng = random.Random(number)
    return Surroundings(
        str(rng.randrange(2**32)),
        rng.choice(("C", "POSIX", "C.UTF-8", "de_DE.UTF-8", "tr_TR.UTF-8", "ar_EG.UTF-8", "")),
        rng.choice(("UTC", "Asia/Kathmandu", "Pacific/Kiritimati", "America/St_Johns", "Europe/Berlin", "ABC-14", "")),
        rng.choice((0o000, 0o002, 0o022, 0o027, 0o077)),
        "".join(rng.choices("abcdefg é_-.", k=rng.randint(1, 60))).strip(" .") or "b",
        str(rng.choice((1, 20, 80, 500))),
    )


def made(base: Path, surroundings: Surroundings, python: str = sys.executable) -> dict[str, bytes]:
    """Every file that the commands leave in a new folder, by its name there."""
    folder = base / surroundings.folder
    folder.mkdir(parents=True)
    (folder / "small.ini").write_text(CONFIG)
    home = base / "home"
    home.mkdir()
    gcc, without = os.environ["PATH"], str(base / "empty")
    commands: list[tuple[str | None, list[str]]] = [(None, command) for command in COMMANDS]
    for name, path in (("gcc", gcc), ("clang", without)):
        commands.append((path, ["size", "run/champion.pkl", "--targets", "cortex-m0", "--json", f"{name}.json"]))
    done = subprocess.run(
        [python, "-c", DRIVER, str(surroundings.umask), json.dumps(commands)],
        cwd=folder,
        env=surroundings.environment(home),
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    assert done.returncode == 0, f"{surroundings}: {done.stderr[-2000:]}"
    files = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    shutil.rmtree(base)
    return files


def assert_same(files: Mapping[str, bytes], expected: Mapping[str, bytes], what: object) -> None:
    assert set(files) == set(expected), what
    different = [name for name in sorted(expected) if files[name] != expected[name]]
    assert different == [], f"{what}: {different} differ"


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return made(tmp_path_factory.mktemp("plain") / "base", Surroundings())


def test_all_that_is_compared_is_there_and_sizes_are_of_two_compilers(expected: dict[str, bytes]) -> None:
    assert {"run/champion.pkl", "run/champion.json", "run/history.csv", "walker.c", "walker.h", "report.html"} <= set(
        expected
    )
    compilers = []
    for name in ("gcc.json", "clang.json"):
        targets = json.loads(expected[name])["targets"]
        assert [target["style"] for target in targets] == ["unrolled", "table"]
        assert all(target["flash_bytes"] > 0 for target in targets)
        compilers.append(targets[0]["compiler"])
    assert shutil.which("arm-none-eabi-gcc") is None or compilers[0] != compilers[1]
    assert "clang" in compilers[1]


@pytest.mark.parametrize("surroundings", VARIED, ids=lambda s: s.zone.replace("/", "-"))
def test_surroundings_do_not_matter(tmp_path: Path, expected: dict[str, bytes], surroundings: Surroundings) -> None:
    assert_same(made(tmp_path / "base", surroundings), expected, surroundings)


@pytest.mark.long
@pytest.mark.parametrize("batch", range(10))
def test_a_hundred_runs_give_the_same_bytes(tmp_path: Path, expected: dict[str, bytes], batch: int) -> None:
    for number in range(10 * batch, 10 * batch + 10):
        assert_same(made(tmp_path / "base", drawn(number)), expected, f"drawn({number}) = {drawn(number)}")


def other_pythons() -> list[str]:
    """Interpreters of other supported versions that have what bitneat needs: on the PATH, or named by BITNEAT_TEST_PYTHONS."""
    named = os.environ.get("BITNEAT_TEST_PYTHONS", "").split(os.pathsep)
    found = [shutil.which(f"python3.{minor}") for minor in range(11, 20) if minor != sys.version_info.minor]
    able = []
    for python in filter(None, [*named, *found]):
        probe = [python, "-c", "import neat, gymnasium, Box2D, cffi, jinja2, wasmtime, unicorn, ziglang"]
        if subprocess.run(probe, capture_output=True, check=False).returncode == 0:
            able.append(python)
    return able


@pytest.mark.long
def test_the_version_of_python_does_not_matter(tmp_path: Path, expected: dict[str, bytes]) -> None:
    pythons = other_pythons()
    if not pythons:
        pytest.skip("no other Python has the packages; name some by BITNEAT_TEST_PYTHONS")
    for number, python in enumerate(pythons):
        files = made(tmp_path / f"base{number}", Surroundings(), python)
        # Provenance says which Python and which packages it was; that is all that may differ.
        mine, theirs = (json.loads(content["run/report.json"])["packages"] for content in (expected, files))
        assert theirs["python"] != mine["python"]
        different = {name for name in mine if mine[name] != theirs[name]}
        page = "report.html"
        files[page] = files[page].replace(b"&#34;", b'"')
        for name in files:
            for package in different:
                files[name] = _with_version(files[name], package, theirs[package], mine[package])
        # A champion's checksum is one of its provenance, too; what it is of has been compared without it.
        wanted = {**expected, page: expected[page].replace(b"&#34;", b'"')}
        for champion in ("run/champion.json", "run/champion.pkl"):
            (theirs_sum, mine_sum) = (_CHECKSUM.findall(content[champion]) for content in (files, wanted))
            assert len(theirs_sum) == len(mine_sum) == 1
            assert theirs_sum != mine_sum
            files[champion] = files[champion].replace(theirs_sum[0], mine_sum[0])
        assert_same(files, wanted, python)


_CHECKSUM = re.compile(rb"content_sha256[^0-9a-f]{1,8}([0-9a-f]{64})", re.DOTALL)


def _with_version(content: bytes, package: str, theirs: str, mine: str) -> bytes:
    """JSON, a pickle or a page in which another version stands behind the name of a package."""
    # A text of a pickle has its length in the byte before it, and up to three codes before that.
    pickled = re.compile(
        re.escape(package.encode()) + rb"(.{1,3})" + bytes([len(theirs)]) + re.escape(theirs.encode()), re.DOTALL
    )
    content = pickled.sub(lambda found: package.encode() + found[1] + bytes([len(mine)]) + mine.encode(), content)
    text = re.compile(
        rb"(\b" + re.escape(package.encode()) + rb"\b[^0-9A-Za-z]{1,24})" + re.escape(theirs.encode()) + rb"\b"
    )
    return text.sub(lambda found: found[1] + mine.encode(), content)
