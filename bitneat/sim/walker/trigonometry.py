# SPDX-License-Identifier: MIT
"""Whether two machines' sine, cosine and arctangent are the same, and so their walkers.

Box2D and the native walker ask the C library for them, and C libraries differ in last bits, one processor's variant of a
function from another's, too. All else in a simulation is exactly rounded arithmetic. So a run keeps a hash of these functions,
and goes on only where they hash alike; whatever sends episodes to other machines must ask the same of them.
"""

from __future__ import annotations

from bitneat.champion import EnvironmentSpec
from bitneat.errors import BitneatError
from bitneat.sim import bipedal
from bitneat.sim.walker.binding import library


def probe() -> str | None:
    """The hash of this machine's ``sinf``, ``cosf`` and ``atan2f`` as 16 hexadecimal digits; None without a C compiler."""
    try:
        return f"{library().trig_probe():016x}"
    except BitneatError:
        return None


def probe_for(spec: EnvironmentSpec) -> str | None:
    """`probe`, or None where the environment is no walker."""
    return probe() if spec.id in bipedal.IDS else None


def refuse_other(expected: str | None, where: str, here: str | None = None) -> None:
    """Refuse to mix episodes of machines whose trigonometry differs. What is unknown on either side is let pass.

    Args:
        expected: the hash that was recorded.
        where: what the message starts with: the file that records it, or the machine that is asked.
        here: the hash to compare; this machine's if not given.

    Raises:
        BitneatError: if both are known and differ.
    """
    if expected is None:
        return
    found = probe() if here is None else here
    if found is not None and found != expected:
        raise BitneatError(
            f"{where}: trigonometry: expected a C library whose sinf, cosf and atan2f hash to {expected}, as where the run"
            f" began, got {found}; its episodes would go otherwise"
        )
