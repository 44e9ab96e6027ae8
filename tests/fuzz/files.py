# SPDX-License-Identifier: MIT
"""The readers of champions and configurations on damaged, hostile and odd files: a valid value, or one line of error.

What is asked of each is in `read_champion` and `read_config`. The fuzzers whose names end in ``-guided`` have them called by
atheris, which looks for files that reach new code; the others draw each file from its number.
"""

from __future__ import annotations

import random
import re
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from bitneat.champion import AnyChampion, Champion, EnvironmentSpec, FloatChampion, dump_pickle, dumps, load_any
from bitneat.codegen import generate
from bitneat.controller import BoxAction, Controller, DiscreteAction, Reference
from bitneat.errors import BitneatError
from bitneat.evolve import config
from bitneat.network import FloatNetwork, FloatNode
from tests.fuzz.mutate import mutate_champion, mutate_config
from tests.fuzz.target import MEMORY, ROOT, WORK, Batch, FindingError, Target
from tests.strategies import random_controller

BATCH = 10_000
GUIDED_BATCH = 20_000
SECONDS = 2.0
"""The most processor time that a file of some kilobytes may take."""
MEGABYTES = 400
"""The most that a batch of files may add to the memory of the process."""
LONGEST_MESSAGE = 1000
REGRESSIONS = Path(__file__).parent / "regressions"


def check(path: Path, content: bytes, read: Callable[[Path], Any]) -> Any:
    """Have a file read and judge the outcome: what was read, or None for a refusal as it should be.

    Raises:
        FindingError: if reading ends in any error but one for the user, in more than one line of printable text, or too late.
    """
    path.write_bytes(content)
    started = time.process_time()
    try:
        return read(path)
    except BitneatError as error:
        message = str(error)
        if not message.isprintable() or len(message) > LONGEST_MESSAGE:
            raise FindingError(
                f"{path.name}: {content.hex()}: a message that is not one line of text: {message!r}"
            ) from None
        return None
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        raise FindingError(
            f"{path.name}: {content.hex()}: {type(error).__name__}: {error!s:.200} ({Path(where.filename).name}:{where.lineno})"
        ) from None
    finally:
        spent = time.process_time() - started
        if spent > SECONDS:
            raise FindingError(f"{path.name}: {content.hex()}: took {spent:.1f} s")


def read_champion(path: Path) -> AnyChampion:
    """A champion from a file, that survives being written in both forms, and whose controller can be stepped and generated."""
    champion = load_any(path)
    for written in (dumps(champion).encode(), dump_pickle(champion)):
        path.write_bytes(written)
        assert load_any(path) == champion, "it is another one after being written and read"
    if isinstance(champion, Champion):
        _use(champion)
    return champion


def _use(champion: Champion) -> None:
    controller: Controller = champion.controller
    canonical = controller.canonical
    assert canonical.canonical == canonical
    vectors = [[entry.limit * sign for entry in controller.inputs] for sign in (1, -1)]
    assert Reference(controller).run(vectors) == Reference(canonical).run(vectors)
    with suppress(BitneatError):  # nothing leads to an output, or the choice does not fit 32 bits
        generate(controller, "c", "unrolled", action=champion.action)


def read_config(path: Path) -> config.Config:
    """A configuration from a file, that is the same when its text is parsed again."""
    read = config.load(str(path))
    assert config.parse(read.text, "again").text == read.text, "it is another one after being written and read"
    return read


@cache
def champion_seeds() -> list[Any]:
    """Champions of every kind, as plain data: small ones, so that many can be read in a second."""
    seeds: list[AnyChampion] = []
    for seed in range(12):
        rng = random.Random(seed)
        controller = random_controller(rng, size="small", num_nodes=rng.randint(1, 4), max_fan_in=4)
        count = len(controller.outputs)
        box = BoxAction((-1.0,) * count, (1.0, *(2.5,) * (count - 1)), (count,), "float32")
        action = box if seed % 2 else DiscreteAction(count, seed)
        environment = EnvironmentSpec("Some-v0", {"hard": True, "x": [1, None]}, ("a.b",)) if seed % 3 else None
        provenance: dict[str, Any] = (
            {"config": "[evolve]\n", "seeds": [1, 2], "score": {"mean": 1.5}} if seed % 3 else {}
        )
        seeds.append(Champion(controller, action, environment, provenance))
    network = FloatNetwork(2, (FloatNode(((0, 0.5), (1, -2.0)), 0.1, 1.0, "tanh"), FloatNode(((2, 1.0),))), (3,))
    seeds.append(FloatChampion(network, DiscreteAction(1)))
    return [champion.to_data() for champion in seeds]


@cache
def config_seeds() -> list[str]:
    """The shipped presets, and a whole configuration with every key of its sections."""
    folder = Path(config.__file__).parent / "presets"
    presets = [path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.ini"))]
    return [*presets, config.load("default").text, config.load("paper-softmax").text]


@dataclass(frozen=True)
class Kind:
    """A kind of file: how one is drawn, and how it is read."""

    what: str
    draw: Callable[[random.Random], bytes]
    read: Callable[[Path], Any]


KINDS = {
    "champions": Kind(
        "damaged and hostile champion files, pickle and JSON: a champion that is written, read, stepped and generated, or one line",
        lambda rng: mutate_champion(champion_seeds(), rng),
        read_champion,
    ),
    "configs": Kind(
        "damaged and odd configurations: one that is written and read again, or one line",
        lambda rng: mutate_config(config_seeds(), rng),
        read_config,
    ),
}


def _drawn_batch(name: str, number: int) -> Batch:
    kind = KINDS[name]
    rng = random.Random(f"{name} {number}")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    valid = 0
    with tempfile.TemporaryDirectory(prefix="bitneat-fuzz-", dir=MEMORY) as folder:
        for _ in range(BATCH):
            valid += check(Path(folder, name), kind.draw(rng), kind.read) is not None
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024
    if grown > MEGABYTES:
        raise FindingError(f"{name}: batch {number} took {grown} MB")
    return Batch(BATCH, {"valid": valid})


def _guided_batch(name: str, number: int) -> Batch:
    corpus = WORK / f"{name}-guided-corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="bitneat-fuzz-", dir=MEMORY) as folder:
        options = [f"-runs={GUIDED_BATCH}", f"-seed={number + 1}", "-max_len=4096", "-timeout=20", "-rss_limit_mb=2048"]
        options.append(f"-artifact_prefix={folder}/")
        command = [sys.executable, "-m", "tests.fuzz.guided", name, folder, *options, str(corpus)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode != 0:
        said = re.findall(r"FindingError: (.*)", done.stdout + done.stderr)
        raise FindingError("; ".join(said) or (done.stdout + done.stderr)[-2000:])
    return Batch(GUIDED_BATCH)


_LIMITS = f"{SECONDS:g} s a file, {MEGABYTES} MB"
TARGETS: dict[str, Target] = {}
for _name, _kind in KINDS.items():
    TARGETS[_name] = Target(
        _kind.what,
        "files",
        _LIMITS,
        lambda: f"Python {sys.version.split()[0]}",
        lambda n, k=_name: _drawn_batch(k, n),  # type: ignore[misc]
    )
    TARGETS[f"{_name}-guided"] = Target(
        f"as `{_name}`, guided by coverage",
        "files",
        _LIMITS,
        lambda: f"atheris {metadata.version('atheris')}",
        lambda n, k=_name: _guided_batch(k, n),  # type: ignore[misc]
        explores=True,
    )
