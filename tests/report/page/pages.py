# SPDX-License-Identifier: MIT
"""Champions for pages, and what is true of their episodes, found out without the page's own code."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bitneat.champion import Champion
from bitneat.cli.main import main
from bitneat.controller import Reference
from bitneat.verify.loop import Comparison, closed_loop

ROOT = Path(__file__).resolve().parents[3]
TINY = ROOT / "examples" / "champions" / "tiny.pkl"
QUICK = ("--targets", "host-unrolled,host-table", "--episodes", "1")
HOSTILE = "</script><script>window.planted=1</script><img src=x onerror='window.planted=2'>\"'&--!>"


@dataclass(frozen=True)
class Truth:
    """One episode as the closed loop of verify saw it: inputs and outputs, and every signal by the reference."""

    reward: float
    inputs: npt.NDArray[np.int16]
    outputs: npt.NDArray[np.int16]
    signals: npt.NDArray[np.int16]

    @property
    def steps(self) -> int:
        return len(self.inputs)


def truth(champion: Champion, seed: int) -> Truth:
    assert champion.environment is not None
    controller = champion.controller.canonical
    comparison = Comparison(controller, champion.action, [])
    (episode,) = closed_loop(comparison, champion.environment, [seed], record=True).episodes
    assert episode.inputs is not None
    assert episode.outputs is not None
    reference = Reference(controller)
    signals = []
    for row in episode.inputs.tolist():
        reference.step(row)
        signals.append(reference.signals)
    return Truth(episode.reward, episode.inputs, episode.outputs, np.array(signals, dtype=np.int16))


def write_page(champion: Path, page: Path, *arguments: str, status: int = 0) -> str:
    """Run ``bitneat report`` and read what it wrote."""
    assert main(["report", str(champion), "-o", str(page), *arguments]) == status
    return page.read_text(encoding="utf-8")


_DATA = re.compile(r'(<script type="application/json" id="data">)(.*?)(</script>)', re.DOTALL)


def data_of(html: str) -> Any:
    """The data that the page's script reads."""
    found = _DATA.search(html)
    assert found is not None
    return json.loads(found[2])


def with_data(html: str, data: Any) -> str:
    """The page with other data, as a fault on the way might leave it."""
    return _DATA.sub(lambda found: found[1] + json.dumps(data).replace("<", "\\u003c") + found[3], html)


def spread_steps(steps: int) -> Sequence[int]:
    """A few steps of an episode, the first and the last among them."""
    return sorted({0, 1, 7, steps // 3, steps // 2, steps - 1})
