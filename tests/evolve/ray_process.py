# SPDX-License-Identifier: MIT
"""Ray in processes of their own, since Ray ends the process that it is in when it sees no way on.

``python -m tests.evolve.ray_process nodes`` runs a cluster of two nodes with a core each on this machine until its input ends, and
prints a line of JSON with its address and the process of the second node; ``refusals ADDRESS`` prints what a run is told that
differs from the cluster's machines, a line for each difference.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
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


def refusals(address: str) -> None:
    """Of a run of another version, and of one with another C library."""
    import ray

    import bitneat
    from bitneat.champion import EnvironmentSpec
    from bitneat.errors import BitneatError
    from bitneat.evolve import cluster
    from bitneat.sim.environment import inspect

    walker = EnvironmentSpec("BipedalWalker-v3")
    controller = bitneat.load(TINY).controller
    for name, value in (("__version__", "9.9"), ("probe_for", lambda spec: "0123456789abcdef")):
        with mock.patch.object(cluster, name, value):
            evaluator = cluster.RayEvaluator(walker, inspect(walker).action, 50, simulator="native", address=address)
        try:
            evaluator.evaluate([controller], [0])
            print("not refused", flush=True)
        except BitneatError as error:
            print(error, flush=True)
        finally:
            evaluator.close()
        assert not ray.is_initialized()


if __name__ == "__main__":
    os.environ.update(QUIET_AND_LOCAL)
    {"nodes": nodes, "refusals": refusals}[sys.argv[1]](*sys.argv[2:])
