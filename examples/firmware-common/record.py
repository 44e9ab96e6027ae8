# SPDX-License-Identifier: MIT
"""Records the trace that the firmware examples walk: a champion in Gymnasium, as the reference computes it.

python record.py ../champions/tiny.pkl trace.txt
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from bitneat import champion as champions
from bitneat.controller import Encoder, Reference
from bitneat.files import write_atomic

SEED = 0
STEPS = 400


def frame(signals: Iterable[int]) -> str:
    """Four hexadecimal digits a signal, in two's complement."""
    return "".join(f"{int(signal) & 0xFFFF:04x}" for signal in signals)


def main(champion_path: str, trace_path: str) -> None:
    """Write the first steps of one episode, after a step at each extreme of the inputs and one at rest."""
    import gymnasium
    import numpy as np

    champion = champions.load(Path(champion_path))
    assert champion.environment is not None
    controller = champion.controller.canonical
    encode, reference = Encoder(controller), Reference(controller)
    limits = [entry.limit for entry in controller.inputs]
    lines = []
    for inputs in (limits, [-limit for limit in limits], [0] * len(limits)):
        lines.append(f"{frame(inputs)} {frame(reference.step(inputs))}")
    reference.reset()
    environment = gymnasium.make(champion.environment.id, **champion.environment.kwargs)
    observation, _ = environment.reset(seed=SEED)
    for _ in range(STEPS):
        signals = [int(signal) for signal in encode(observation)]
        outputs = reference.step(signals)
        lines.append(f"{frame(signals)} {frame(outputs)}")
        action = champion.action.decode(np.array(outputs, np.int16), controller.frac_bits)
        observation, _, terminated, truncated, _ = environment.step(action)
        if terminated or truncated:
            break
    write_atomic(Path(trace_path), ("\n".join(lines) + "\n").encode("ascii"))


if __name__ == "__main__":
    main(*sys.argv[1:3])
