# SPDX-License-Identifier: MIT
"""A controller from end to end in seconds: built, generated, compiled, run everywhere, and compared bit for bit."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bitneat.codegen import generate
from bitneat.controller import ACTIVATION_NAMES, Controller, Input, Link, Node, Reference, Signal
from bitneat.doctor.finding import Finding
from bitneat.errors import BitneatError, CheckFailedError
from bitneat.native import build
from bitneat.verify.cfile import CFile
from bitneat.verify.check import domain_vectors
from bitneat.verify.implementation import ImplementationError
from bitneat.verify.targets import ReadyTarget, select

SECTION = "self-test"
STEPS = 100
"""Of the walker, and vectors of the controller."""

_WALKER = "BipedalWalker-v3"


def native_builds() -> list[Finding]:
    """The two libraries that bitneat compiles for itself on first use, and where they are kept."""
    from bitneat.runtime import RuntimeController
    from bitneat.sim.walker.binding import library

    return [
        _built("C runtime", lambda: RuntimeController(tiny()), "evolve, polish, quantize, Controller.step", True),
        _built("native walker", library, "BipedalWalker at tens of times Gymnasium's speed", False),
    ]


def _built(name: str, load: Callable[[], object], enables: str, required: bool) -> Finding:
    compiled: list[str] = []
    before, build.announce = build.announce, compiled.append
    start = time.monotonic()
    try:
        load()
    except (BitneatError, OSError) as error:
        remedy = "a working C compiler, see above"
        return Finding("native builds", name, "failed", str(error), enables, remedy, required)
    finally:
        build.announce = before
    how = f"compiled now, in {time.monotonic() - start:.1f} s, into" if compiled else "compiled before, in"
    return Finding("native builds", name, "found", f"{how} {build.cache_dir()}", enables, required=required)


def selftest() -> list[Finding]:
    """Run the same controller everywhere, and the same walker in both simulators."""
    controller = tiny()
    vectors = domain_vectors(controller, STEPS)[0]
    expected = np.array(Reference(controller).run(vectors.tolist()), np.int16)
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder:
        on_targets = [
            _trial(
                f"C on {ready.target.name}",
                lambda ready=ready: _on_target(ready, controller, vectors, expected, Path(folder)),  # type: ignore[misc]
                "codegen and verify" if ready.target.loads_on_host else f"verify --targets {ready.target.name}",
                "its compiler and emulator, see above",
                required=ready.target.loads_on_host,
            )
            for ready in _ready()
        ]
    return [
        _trial(
            "C runtime",
            lambda: _in_runtime(controller, vectors, expected),
            "evolve: what the search sees",
            "the C compiler, see above",
            required=True,
        ),
        *on_targets,
        _trial(
            "walker's trigonometry",
            _trigonometry,
            "the native walker at full speed",
            "nothing has to be done: it asks the C library instead, and gives the same bits more slowly",
        ),
        _trial(
            "walker against Gymnasium",
            _walker,
            "evolve in the native walker",
            "evolve --simulator gymnasium; the Box2D here is not the one that the native walker repeats",
            required=True,
        ),
    ]


def tiny() -> Controller:
    """A controller with a node for each activation, delayed links, gains of both signs and biases."""
    first = 3
    nodes = []
    for i, name in enumerate(ACTIVATION_NAMES):
        links = [Link(i % first), Link((i + 1) % first, sign=-1)]
        if i:
            links.append(Link(first + i - 1, delay=i % 2))
        nodes.append(Node(tuple(links), 256 * (i % 3 - 1), i % 4 - 2, name))
    outputs = tuple(Signal(first + i) for i in range(len(nodes)))
    return Controller((Input(), Input(limit=512), Input(limit=1000)), tuple(nodes), outputs, 8)


def _trial(name: str, run: Callable[[], str], enables: str, remedy: str, *, required: bool = False) -> Finding:
    """A finding by whether ``run`` raises; what it returns is the detail."""
    try:
        detail = run()
    except (BitneatError, ImplementationError, OSError) as error:
        return Finding(SECTION, name, "failed", str(error), enables, remedy, required)
    return Finding(SECTION, name, "found", detail, enables, required=required)


def _compare(got: npt.NDArray[np.int16], expected: npt.NDArray[np.int16]) -> str:
    wrong = np.argwhere(got != expected)
    if len(wrong):
        step, output = wrong[0].tolist()
        raise CheckFailedError(
            f"step {step}: output {output} is {got[step, output]}, expected {expected[step, output]};"
            f" {len(wrong)} of {expected.size} outputs differ"
        )
    return f"{expected.size} outputs, 0 differing bits"


def _in_runtime(controller: Controller, vectors: npt.NDArray[np.int16], expected: npt.NDArray[np.int16]) -> str:
    from bitneat.runtime import RuntimeController

    runtime = RuntimeController(controller)
    return _compare(np.array([runtime.step(row) for row in vectors]), expected)


def _ready() -> list[ReadyTarget]:
    """The targets where code can run; none if there is no compiler at all, which `bitneat.doctor.tools` reports."""
    try:
        return [ready for ready in select(None) if ready.runs]
    except BitneatError:
        return []


def _on_target(
    ready: ReadyTarget,
    controller: Controller,
    vectors: npt.NDArray[np.int16],
    expected: npt.NDArray[np.int16],
    folder: Path,
) -> str:
    compared = []
    for style in ready.target.styles:
        code = CFile.write(generate(controller, f"tiny_{style}", style, encoding="bytes"), folder)
        for implementation in ready.target.implementations(code, ready.toolchain):
            with closing(implementation):
                implementation.reset()
                compared.append(_compare(implementation.run(vectors), expected))
    return f"{len(compared)} entry points, each {compared[0]}"


def _trigonometry() -> str:
    """Whether the C library's sine and cosine are those of the formula that the walker's lanes use, in 330,000 values."""
    from bitneat.sim.walker.binding import library
    from bitneat.sim.walker.trigonometry import probe

    if not library().simulator_open():
        raise CheckFailedError(f"the C library's sines are not those of the formula (it hashes to {probe()})")
    return f"the C library's sines are those of the formula; it hashes to {probe()}"


def _walker() -> str:
    """The same random actions in the native walker and in Gymnasium."""
    import gymnasium

    from bitneat.champion import EnvironmentSpec
    from bitneat.sim import WalkerVectorEnv
    from bitneat.sim.walker.original import obstacle

    reason = obstacle(EnvironmentSpec(_WALKER))
    if reason is not None:
        raise CheckFailedError(reason)
    actions = np.random.default_rng(0).uniform(-1, 1, (STEPS, 4)).astype(np.float32)
    walker, native = gymnasium.make(_WALKER), WalkerVectorEnv(1)
    with closing(walker), closing(native):
        observation, observations = walker.reset(seed=0)[0], native.reset(seed=0)[0]
        for step, action in enumerate(actions):
            if observation.tobytes() != observations[0].tobytes():
                raise CheckFailedError(f"seed 0, step {step}: the observations differ")
            observation, reward, terminated, *_ = walker.step(action)
            observations, rewards, terminations, *_ = native.step(action[None])
            if (float(reward), terminated) != (float(rewards[0]), bool(terminations[0])):
                raise CheckFailedError(f"seed 0, step {step}: rewards or ends differ")
            if terminated:
                break
    return f"{step + 1} steps, 0 differing bits"
