# SPDX-License-Identifier: MIT
"""Ray in processes of their own, since Ray ends the process that it is in when it sees no way on.

``python -m tests.evolve.ray_process nodes`` runs a cluster of two nodes with a core each on this machine until its input ends, and
prints a line of JSON with its address and the process of the second node; ``refusals ADDRESS`` prints what a run is told that
differs from the cluster's machines or fails there, a line each, and whether a run that is to use one core uses one.
"""

from __future__ import annotations

import json
import os
import pickle
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest import mock

# Ray reads these when it is imported. By the second, all of it listens to this machine alone, as on systems other than Linux.
QUIET_AND_LOCAL = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}
TINY = Path(__file__).parents[2] / "examples" / "champions" / "tiny.pkl"


def nodes() -> None:
    """A head with one core, and another node with one."""
    from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "object_store_memory": 80_000_000, "node_ip_address": "127.0.0.1"}
    cluster = Cluster(initialize_head=True, head_node_args={**node, "include_dashboard": False})
    other = cluster.add_node(**node)
    ((raylet,),) = [other.all_processes["raylet"]]
    print(json.dumps({"address": cluster.address, "raylet": raylet.process.pid}), flush=True)
    sys.stdin.read()
    cluster.shutdown()


def fails(versioned: object, job: bytes) -> object:
    """In the place of a task: what nobody foresaw."""
    raise ZeroDivisionError("by zero")


def times(versioned: object, job: bytes) -> tuple[str, list[list[tuple[float, float]]]]:
    """In the place of a task: when it began and ended, as the result of every episode."""
    began = time.time()
    time.sleep(0.5)
    controllers, seeds, _ = pickle.loads(job)
    return "episodes", [[(began, time.time())] * len(seeds) for _ in controllers]


def refusals(address: str) -> None:
    """Of runs that differ from the cluster's machines, and of what fails there."""
    import ray

    import bitneat
    from bitneat.champion import EnvironmentSpec
    from bitneat.errors import BitneatError
    from bitneat.evolve import cluster
    from bitneat.sim.environment import inspect

    cart = EnvironmentSpec("CartPole-v1")
    controller = bitneat.load(TINY).controller

    def evaluated(spec: EnvironmentSpec, seeds: list[int], workers: int | None = None) -> list[list[Any]]:
        evaluator = cluster.RayEvaluator(
            spec, inspect(cart).action, 50, simulator="gymnasium", address=address, workers=workers
        )
        try:
            return evaluator.evaluate([controller], seeds)
        finally:
            evaluator.close()
            assert not ray.is_initialized()

    changes: list[tuple[str, object, EnvironmentSpec]] = [
        ("__version__", "9.9", cart),
        ("_versions", lambda: {"numpy": "0.1", "mujoco": "1.0"}, cart),
        ("probe", lambda: "0123456789abcdef", cart),
        ("__version__", cluster.__version__, EnvironmentSpec("Nowhere-v0")),
        ("_run", fails, cart),
    ]
    for name, value, spec in changes:
        with mock.patch.object(cluster, name, value):
            try:
                evaluated(spec, [0])
                print("not refused", flush=True)
            except BitneatError as error:
                print(error, flush=True)
    with mock.patch.object(cluster, "_run", times):
        spans = sorted(set(evaluated(cart, list(range(12)), workers=1)[0]))
    print(len(spans), all(end <= began for (_, end), (began, _) in pairwise(spans)), flush=True)


if __name__ == "__main__":
    os.environ.update(QUIET_AND_LOCAL)
    {"nodes": nodes, "refusals": refusals}[sys.argv[1]](*sys.argv[2:])
