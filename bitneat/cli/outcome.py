# SPDX-License-Identifier: MIT
"""How the commands that make champions say what they made, to people and as JSON."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from bitneat.errors import printable

if TYPE_CHECKING:
    from bitneat.network import Policy


def warn(text: str) -> None:
    """Say on stderr, in a line, what a user should know though the command goes on."""
    print("bitneat:", printable(" ".join(text.split("\n"))), file=sys.stderr, flush=True)


def say_how_to_go_on(stop: KeyboardInterrupt, command: str, *, begun: bool) -> None:
    """Let an interrupt end the command with how to go on, or with that nothing was kept where there is no checkpoint yet."""
    if begun:
        stop.args = (f"stopped; continue with: {command}",)
    else:
        stop.args = (
            "stopped before the first generation was complete; nothing is kept: the same command begins again",
        )


def controller_data(controller: Policy) -> dict[str, Any]:
    """The ``controller`` of a command's JSON; a float network is not ternary and has no packed form."""
    from bitneat.controller.packing import pack
    from bitneat.network import FloatNetwork

    if isinstance(controller, FloatNetwork):
        return {
            "sha256": controller.sha256,
            "ternary": False,
            "nodes": len(controller.nodes),
            "links": controller.num_links,
            "packed_bytes": None,
        }
    return {
        "sha256": controller.sha256,
        "ternary": controller.is_ternary,
        "nodes": len(controller.nodes),
        "links": controller.num_links,
        "packed_bytes": len(pack(controller)),
    }


def print_champion(summary: Mapping[str, Any]) -> None:
    """Two lines about a champion: its ``held_out`` score and its size, and the file it is in."""
    score, controller = summary["held_out"], summary["controller"]
    size = "float weights" if controller["packed_bytes"] is None else f"{controller['packed_bytes']} bytes packed"
    print(
        f"champion: {score['mean']:.1f} ± {score['std']:.1f} over {score['episodes']} held-out episodes"
        f" (min {score['min']:.1f}, max {score['max']:.1f}), {controller['nodes']} nodes, {controller['links']} links,"
        f" {size}"
    )
    print(f"written: {summary['champion']}")
