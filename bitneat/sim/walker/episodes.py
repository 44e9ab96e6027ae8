# SPDX-License-Identifier: MIT
"""Whole episodes of many controllers on many seeds, without Python in between."""

from __future__ import annotations

import math
import operator
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from bitneat.controller import BoxAction, Controller
from bitneat.errors import BitneatError
from bitneat.network import ACTIVATIONS, FloatNetwork, Policy
from bitneat.runtime import OpenBlob, pack_for_runtime
from bitneat.sim.environment import EpisodeResult, Shaping, decode_table, used_inputs
from bitneat.sim.walker.binding import (
    MAX_THREADS,
    default_threads,
    ffi,
    lane_width,
    library,
    random_state,
    whole_number,
)

NUM_INPUTS, NUM_OUTPUTS = 24, 4
FIRST_RAY = 14
ACTION = BoxAction((-1.0,) * NUM_OUTPUTS, (1.0,) * NUM_OUTPUTS, (NUM_OUTPUTS,), "float32")
"""BipedalWalker's action space."""

_UNDONE, _OVERFLOW = 1, 2
"""What C leaves in ``failed``."""


def run_episodes(
    controllers: Sequence[Policy],
    seeds: Sequence[int],
    max_steps: int = 1600,
    *,
    hardcore: bool = False,
    lanes: int | None = None,
    threads: int | None = None,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    """Run every controller on every seed, each episode from a fresh start until it terminates or has had ``max_steps`` steps.

    Args:
        controllers: of 24 inputs and 4 outputs; float networks too.
        seeds: as of Gymnasium's ``reset(seed=…)``.
        max_steps: the time limit.
        hardcore: with ladders, stumps and pitfalls.
        lanes: walkers side by side in a thread, 1, 4, 8 or 16; the widest that the machine has instructions for if not
            given. It changes no bit, nor do ``threads``.
        threads: one a core if not given.

    Returns:
        The official rewards, summed in float64 in the order of the steps, and the steps taken; both (controllers, seeds).

    Raises:
        BitneatError: if a controller does not fit the walker, or an argument is out of range.
    """
    episodes = evaluate(controllers, seeds, max_steps, hardcore=hardcore, lanes=lanes, threads=threads)
    shape = (len(controllers), len(seeds))
    rewards = np.array([episode.reward for row in episodes for episode in row], np.float64).reshape(shape)
    steps = np.array([episode.steps for row in episodes for episode in row], np.int32).reshape(shape)
    return rewards, steps


def evaluate(
    controllers: Sequence[Policy],
    seeds: Sequence[int],
    max_steps: int,
    shaping: Shaping | None = None,
    *,
    hardcore: bool = False,
    lanes: int | None = None,
    threads: int | None = None,
) -> list[list[EpisodeResult]]:
    """As `run_episodes`, with the search's reward too: the episodes, by controller and then by seed."""
    width = lane_width(lanes)
    threads = default_threads() if threads is None else whole_number("threads", threads, MAX_THREADS)
    max_steps = whole_number("max_steps", max_steps)
    if len(controllers) == 0 or len(seeds) == 0:  # either may be an array, which has no truth value
        return [[] for _ in controllers]
    policies = _Policies(controllers)
    grounds = ffi().new("struct pcg64[]", len(seeds))
    for ground, seed in zip(grounds, seeds, strict=True):
        ffi().buffer(ffi().addressof(ground))[:] = _seed_state(_seed(seed))
    # Neighbours share their seed, so that a lane that takes the next episode mostly finds its ground made.
    order = np.empty((len(seeds), len(controllers), 2), np.int32)
    order[:, :, 0] = np.arange(len(controllers))
    order[:, :, 1] = np.arange(len(seeds))[:, None]
    results = ffi().new("struct result[]", len(seeds) * len(controllers))
    limits = _shaping(shaping or Shaping(), max_steps)
    _run(policies, grounds, order, limits, results, hardcore=hardcore, lanes=width, threads=threads)
    table: list[list[EpisodeResult]] = [[] for _ in controllers]
    for index in range(len(seeds) * len(controllers)):
        r = results[index]
        if r.failed or not math.isfinite(r.reward):
            reason = {_UNDONE: "out of memory", _OVERFLOW: "a body touches more shapes than there is room for"}
            raise BitneatError(
                f"native walker: the episode of seed {seeds[index // len(controllers)]} failed:"
                f" {reason.get(r.failed, f'its reward is {r.reward}')}; use --simulator gymnasium"
            )
        table[index % len(controllers)].append(
            EpisodeResult(r.reward, r.shaped, r.steps, bool(r.terminated), bool(r.stalled))
        )
    return table


def _run(
    policies: _Policies,
    grounds: Any,
    order: Any,
    shaping: Any,
    results: Any,
    *,
    hardcore: bool,
    lanes: int,
    threads: int,
) -> None:
    """Call C from a thread of its own, so that Ctrl-C is heard meanwhile."""
    stop = ffi().new("int32_t *")
    call = library().simulator_run
    failure: list[BaseException] = []

    def work() -> None:  # holds on to all that C reads and writes, whatever becomes of the caller
        try:
            episodes = ffi().cast("struct episode *", ffi().from_buffer(order))
            structs = policies.structs
            call(structs, grounds, hardcore, episodes, len(results), shaping, results, lanes, threads, stop)
        except BaseException as error:  # what a thread raises is lost, and results of zeros look like episodes
            failure.append(error)

    worker = threading.Thread(target=work, daemon=True)
    try:
        worker.start()
        worker.join()
    except BaseException:
        stop[0] = 1
        if worker.is_alive():
            worker.join()
        raise
    if failure:
        raise failure[0]


class _Policies:
    """The C side's view of controllers and networks, with what keeps it alive."""

    def __init__(self, policies: Sequence[Policy]) -> None:
        self.structs = ffi().new("struct policy[]", len(policies))
        self._keep: list[Any] = []
        for struct, policy in zip(self.structs, policies, strict=True):
            inputs = policy.num_inputs if isinstance(policy, FloatNetwork) else len(policy.inputs)
            if (inputs, len(policy.outputs)) != (NUM_INPUTS, NUM_OUTPUTS):
                raise BitneatError(
                    f"native walker: expected a controller of {NUM_INPUTS} inputs and {NUM_OUTPUTS} outputs,"
                    f" got {inputs} and {len(policy.outputs)}"
                )
            if isinstance(policy, FloatNetwork):
                read = policy.used_inputs()
                network = network_struct(policy)
                self._keep.append(network)
                struct.network = network.pointer
            else:
                read = used_inputs(policy)
                self._take(struct, policy)
            struct.rays = sum(1 << (i - FIRST_RAY) for i in read if i >= FIRST_RAY)

    def _take(self, struct: Any, controller: Controller) -> None:
        blob = OpenBlob(pack_for_runtime(controller), validate=False)
        factor = np.array([2.0 ** (controller.frac_bits + i.scale) for i in controller.inputs])
        limit = np.array([float(i.limit) for i in controller.inputs])
        actions = decode_table(ACTION, controller.frac_bits)
        self._keep.append((blob, factor, limit, actions))
        struct.controller = blob.pointer
        struct.factor = ffi().from_buffer("double[]", factor)
        struct.limit = ffi().from_buffer("double[]", limit)
        struct.actions = ffi().from_buffer("float[]", actions)
        struct.one = 1 << controller.frac_bits


@dataclass(frozen=True)
class NetworkStruct:
    """A ``struct network`` and the arrays that it points into."""

    pointer: Any
    arrays: tuple[npt.NDArray[Any], ...]


def network_struct(network: FloatNetwork) -> NetworkStruct:
    """The C side's view of a float network."""
    numbers = {name: index for index, name in enumerate(ACTIVATIONS)}
    links = [link for node in network.nodes for link in node.links]
    arrays: dict[str, npt.NDArray[Any]] = {
        "bias": np.array([node.bias for node in network.nodes], np.float64),
        "response": np.array([node.response for node in network.nodes], np.float64),
        "weight": np.array([weight for _, weight in links], np.float64),
        "activation": np.array([numbers[node.activation] for node in network.nodes], np.int32),
        "first_link": np.cumsum([0, *(len(node.links) for node in network.nodes)], dtype=np.int32),
        "source": np.array([source for source, _ in links], np.int32),
        "output": np.array(network.outputs, np.int32),
    }
    pointer = ffi().new("struct network *")
    for name, array in arrays.items():
        kind = "double[]" if array.dtype == np.float64 else "int32_t[]"
        setattr(pointer, name, ffi().from_buffer(kind, array))
    pointer.num_inputs, pointer.num_nodes = network.num_inputs, len(network.nodes)
    pointer.num_outputs = len(network.outputs)
    return NetworkStruct(pointer, tuple(arrays.values()))


def _shaping(shaping: Shaping, max_steps: int) -> Any:
    limit = min(max_steps, shaping.max_steps or max_steps)
    return ffi().new(
        "struct shaping *",
        {
            "fall_reward": shaping.fall_reward,
            "fall_value": shaping.fall_value,
            "finish_bonus": shaping.finish_bonus,
            "stall_gain": shaping.stall_gain,
            "max_steps": limit,
            "stall_steps": shaping.stall_steps or limit,
        },
    )


def _seed(value: Any) -> int:
    try:
        seed = operator.index(value)
    except TypeError:
        seed = -1
    if seed < 0:
        raise BitneatError(f"seed: expected a whole number of at least 0, got {value!r}")
    return seed


@lru_cache(maxsize=1 << 16)
def _seed_state(seed: int) -> bytes:
    """The bytes of a ``struct pcg64`` after ``reset(seed=seed)`` of any Gymnasium environment."""
    state = random_state(np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed))))
    return bytes(ffi().buffer(state))
