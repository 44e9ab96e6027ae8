# SPDX-License-Identifier: MIT
"""Episodes on a Ray cluster: the same results, to the bit, as on one machine.

What an episode gives depends on controller, seed and environment alone, and results are put back by their place, so neither the
number of machines nor their order of finishing can show. What could show is asked of every machine before it runs anything: its
versions of bitneat and of the packages that simulate, and its C library's trigonometry. A task whose worker or whole machine dies
runs again elsewhere.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import platform
import re
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from types import FrameType
from typing import Any

from bitneat.champion import EnvironmentSpec
from bitneat.controller import Action
from bitneat.errors import BitneatError, MissingExtraError
from bitneat.evolve.evaluation import Evaluator, GymnasiumEvaluator, NativeWalkerEvaluator
from bitneat.network import Policy
from bitneat.sim.environment import EpisodeResult, Shaping, allow_imports, allowed_imports
from bitneat.sim.walker.trigonometry import probe, refuse_other
from bitneat.version import __version__, installed_version

TASKS_A_CORE = 4
"""So many tasks for each core in a call, so that cores which are done early find more to do."""
LEAST_EPISODES = {"native": 16, "auto": 2, "gymnasium": 2}
"""In a task, by simulator: an episode for each lane; elsewhere enough to outweigh a message."""
RETRIES = 20
"""How often a task may lose its worker before the run gives up: machines come and go, but a crash may also repeat for ever."""
_PATIENCE_SECONDS = 60.0
_POLL_SECONDS = 0.2
_KNOCK_SECONDS = 10.0
_ADDRESS = re.compile(r"(?P<client>ray://)?(?P<host>\[[^]/]+\]|[^/:]+)(:(?P<port>\d{1,5}))?")
_PORTS = {True: 10001, False: 6379}
"""Ray's own, of a client (``ray://``) and of the head."""
_PACKAGES = {
    "gymnasium": ("gymnasium",),
    "numpy": ("numpy",),
    "Box2D": ("box2d", "box2d-py"),
    "mujoco": ("mujoco",),
    "neat-python": ("neat-python",),
}
"""What decides how an episode goes, by what installs it."""
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


@dataclass(frozen=True)
class _Home:
    """What every task of a run has in common."""

    spec: EnvironmentSpec
    action: Action
    max_steps: int
    simulator: str
    trigonometry: str | None
    imports: tuple[str, ...]


@dataclass(frozen=True)
class Chunk:
    """A rectangle of the table of controllers and seeds, which one task runs."""

    controllers: slice
    seeds: slice


def chunks(num_controllers: int, num_seeds: int, cores: int, least: int) -> Iterator[Chunk]:
    """Cut a table of episodes into tasks: about `TASKS_A_CORE` for each core, none below ``least`` episodes if others allow it.

    Rows stay whole as long as they fit a task, since a controller is sent with each of its pieces.
    """
    if not num_controllers or not num_seeds:
        return
    episodes = max(least, -(-num_controllers * num_seeds // (TASKS_A_CORE * max(cores, 1))))
    rows, columns = max(1, episodes // num_seeds), min(num_seeds, episodes)
    for row in range(0, num_controllers, rows):
        for column in range(0, num_seeds, columns):
            yield Chunk(slice(row, min(row + rows, num_controllers)), slice(column, min(column + columns, num_seeds)))


class RayEvaluator:
    """Episodes spread over the cores of a Ray cluster.

    Args:
        spec: the environment.
        action: its action space.
        max_steps: the time limit of an episode.
        simulator: as `bitneat.evolve.simulators.choose` returns it; every machine must have it.
        address: of the cluster, as of ``ray.init``; None starts one on this machine, unless ``RAY_ADDRESS`` is set.
        workers: cores to use at most, of a cluster that is started here or of one at an address; None for all.
        warn: told in a line when nothing has come back for long.

    Raises:
        MissingExtraError: if Ray is not installed.
        BitneatError: if there is no cluster at the address.
    """

    def __init__(
        self,
        spec: EnvironmentSpec,
        action: Action,
        max_steps: int,
        *,
        simulator: str,
        address: str | None = None,
        workers: int | None = None,
        warn: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._ray = _ray()
        self._warn = warn
        self.spec, self.action, self.max_steps = spec, action, max_steps
        self._least = LEAST_EPISODES[simulator]
        self._mine = not self._ray.is_initialized()
        local = self._mine and _connect(self._ray, address, workers)
        self._most = None if local else workers
        """Tasks that may be under way at a time; a cluster of our own has no more cores, and may have its next ones ready."""
        home = _Home(spec, action, max_steps, simulator, probe(), tuple(allowed_imports()))
        # The versions stand outside: another one may not be able to read the rest.
        self._home = self._ray.put(({"bitneat": __version__, **_versions()}, pickle.dumps(home)))
        self._task = self._ray.remote(num_cpus=1, max_retries=RETRIES)(_run)

    def evaluate(
        self, controllers: Sequence[Policy], seeds: Sequence[int], shaping: Shaping | None = None
    ) -> list[list[EpisodeResult]]:
        """The episodes, by controller and then by seed.

        Raises:
            BitneatError: if a machine refuses, an episode fails, or the cluster is lost.
        """
        try:
            with _deferred_signals() as deliver:
                return self._evaluate(controllers, seeds, shaping, deliver)
        except self._ray.exceptions.RayTaskError as error:
            raise BitneatError(f"--evaluator ray: {_task_failure(error)}") from None
        except (self._ray.exceptions.RayError, ConnectionError) as error:
            raise BitneatError(f"--evaluator ray: the cluster was lost: {_first_line(error)}") from None

    def _evaluate(
        self,
        controllers: Sequence[Policy],
        seeds: Sequence[int],
        shaping: Shaping | None,
        deliver: Callable[[], None],
    ) -> list[list[EpisodeResult]]:
        cores = int(self._ray.cluster_resources().get("CPU", 1))
        owners: dict[Any, Chunk] = {}

        def started() -> Iterator[Any]:
            for chunk in chunks(len(controllers), len(seeds), min(cores, self._most or cores), self._least):
                job = pickle.dumps((list(controllers[chunk.controllers]), list(seeds[chunk.seeds]), shaping))
                reference = self._task.remote(self._home, job)
                owners[reference] = chunk
                yield reference

        table: list[list[Any]] = [[None] * len(seeds) for _ in controllers]
        try:
            for reference in self._finished(started(), deliver):
                kind, content = self._ray.get(reference)
                if kind == "error":
                    raise BitneatError(content)
                chunk = owners[reference]
                for row, episodes in zip(table[chunk.controllers], content, strict=True):
                    row[chunk.seeds] = episodes
        except BaseException:
            # Tasks end with the connection, where that is ours. To cancel one that is just ending may end this process: Ray checks
            # that what completes is still pending.
            if not self._mine:
                with contextlib.suppress(Exception):  # the cluster may be what failed
                    _, pending = self._ray.wait(list(owners), num_returns=len(owners), timeout=0)
                    for reference in pending:
                        self._ray.cancel(reference)
            raise
        return table

    def _finished(self, started: Iterator[Any], deliver: Callable[[], None]) -> Iterator[Any]:
        """References as they come in; to take one from ``started`` starts its task.

        ``deliver`` is called at least every `_POLL_SECONDS`.
        """
        pending = list(islice(started, self._most))
        heard = time.monotonic()
        while pending:
            done, pending = self._ray.wait(pending, num_returns=1, timeout=_POLL_SECONDS)
            deliver()
            if done:
                heard = time.monotonic()
            elif time.monotonic() - heard >= _PATIENCE_SECONDS:
                heard = time.monotonic()
                nodes = sum(bool(node["Alive"]) for node in self._ray.nodes())
                self._warn(f"waiting for {len(pending)} tasks; nodes that are up: {nodes}")
            pending += islice(started, len(done))
            yield from done

    def close(self) -> None:
        """Disconnect; a cluster that was started here ends."""
        if self._mine:
            self._ray.shutdown()


@contextlib.contextmanager
def _deferred_signals() -> Iterator[Callable[[], None]]:
    """Keep SIGINT and SIGTERM until what is returned is called, or until the end.

    Their handlers raise, and from within Ray, which frees references at any time, an exception may be lost.
    """
    received: list[int] = []
    handlers: dict[int, Callable[[int, FrameType | None], object]] = {}

    def restore() -> None:
        for number, handler in handlers.items():
            signal.signal(number, handler)

    def deliver() -> None:
        if received:
            restore()  # first: a handler may put another in its own place
            number = received[0]
            received.clear()
            handlers.pop(number)(number, None)

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            handler = signal.getsignal(number)
            if callable(handler):
                handlers[number] = handler
                signal.signal(number, lambda number, frame: received.append(number))
    try:
        yield deliver
    finally:
        restore()
        deliver()


def _ray() -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # Ray would hide accelerators from tasks that ask for none, and warn of that; episodes never touch them.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError:
        raise MissingExtraError("--evaluator ray: needs Ray: pip install 'bitneat[cluster]'") from None
    return ray


def _connect(ray: Any, address: str | None, workers: int | None) -> bool:
    """Connect to a cluster, or start one; returns whether it was started."""
    address = _with_port(address or os.environ.get("RAY_ADDRESS") or "local")
    options: dict[str, Any] = {"address": address, "log_to_driver": False, "logging_level": "error"}
    if address == "local":  # for this process alone, so it listens to this machine alone
        options |= {"num_cpus": workers, "include_dashboard": False, "_node_ip_address": "127.0.0.1"}
    handler = signal.getsignal(signal.SIGTERM)
    try:
        _knock(address)
        ray.init(**options)
    except Exception as error:  # Ray has many for an address where nobody answers
        raise BitneatError(f"--ray-address {address}: no cluster: {_first_line(error)}") from None
    finally:
        # Ray puts its own in the place of ours, which ends a run with its checkpoint kept and a line on how to go on.
        if handler is not None and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, handler)
    return address == "local"


def _with_port(address: str) -> str:
    """The address with Ray's own port where it names a machine alone."""
    found = _ADDRESS.fullmatch(address)
    if found is None or found["port"] is not None or address in ("auto", "local"):
        return address
    return f"{address}:{_PORTS[found['client'] is not None]}"


def _knock(address: str) -> None:
    """Fail at once where nobody listens; Ray itself would go on trying for many minutes."""
    found = _ADDRESS.fullmatch(address)
    if found is not None and found["port"] is not None:
        socket.create_connection((found["host"].strip("[]"), int(found["port"])), _KNOCK_SECONDS).close()


def _run(versioned: tuple[dict[str, str], bytes], job: bytes) -> tuple[str, Any]:
    """What a task does, in a worker anywhere; both arguments come from the run's own process."""
    versions, home_data = versioned
    where = f"node {platform.node()}"
    try:
        _refuse_other_versions(versions, where)
        home: _Home = pickle.loads(home_data)
        if (here := _trigonometry()) is not None:
            refuse_other(home.trigonometry, where, here)
    except BitneatError as error:
        return "error", str(error)
    try:
        allow_imports(home.imports)
        controllers, seeds, shaping = pickle.loads(job)
        return "episodes", _local(home).evaluate(controllers, seeds, shaping)
    except BitneatError as error:
        return "error", f"{where}: {error}"


@cache
def _trigonometry() -> str | None:
    """Once in a process, and not for each task; None without a C compiler, which is then not looked for again."""
    return probe()


@cache
def _versions() -> dict[str, str]:
    """Of the packages that are installed here, of those that decide how an episode goes."""
    found = {}
    for name, distributions in _PACKAGES.items():
        installed = filter(None, map(installed_version, distributions))
        if (first := next(installed, None)) is not None:
            found[name] = first
    return found


def _refuse_other_versions(expected: dict[str, str], where: str) -> None:
    """What is missing on either side is let pass: episodes that need it fail by its name."""
    here = {"bitneat": __version__, **_versions()}
    for name, version in expected.items():
        if here.get(name, version) != version:
            raise BitneatError(f"{where}: has {name} {here[name]}, expected {version}, as where the run began")


def _local(home: _Home) -> Evaluator:
    if home.simulator == "native":
        return NativeWalkerEvaluator(home.spec, home.max_steps, 1)
    return GymnasiumEvaluator(home.spec, home.action, home.max_steps, 1, home.simulator)


def _task_failure(error: Exception) -> str:
    """Where a task failed, and the last line of why: of what Ray wraps, whose own text is a traceback in colours."""
    text = _COLOUR.sub("", str(error))
    node = getattr(error, "ip", None) or (
        match[1] if (match := re.search(r"\bip=([0-9a-fA-F.:]+)", text)) else "unknown"
    )
    cause = getattr(error, "cause", None) or error
    lines = _COLOUR.sub("", str(cause)).strip().splitlines()
    reason = f"{type(cause).__name__}: {lines[0]}" if len(lines) == 1 else (lines or [type(cause).__name__])[-1]
    return f"node {node}: a task failed: {reason.strip()[:200]}"


def _first_line(error: Exception) -> str:
    return (_COLOUR.sub("", str(error)).strip().splitlines() or [type(error).__name__])[0][:200]
