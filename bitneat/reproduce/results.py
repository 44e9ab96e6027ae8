# SPDX-License-Identifier: MIT
"""What a run came to, as plain data in a JSON file of its own: all that tables and figures are made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from bitneat.controller import Controller
from bitneat.errors import BitneatError
from bitneat.files import read_capped, write_atomic
from bitneat.network import FloatNetwork, Policy, network_from_data
from bitneat.state import seal, unseal

FORMAT = "bitneat-reproduction"
_MAX_BYTES = 1 << 26


@dataclass(frozen=True)
class Result:
    """One job's result. Scores are official rewards as of `Score.to_data`, over the report seeds."""

    job: str
    group: str
    system: str
    seed: int
    command: str
    """What makes it again."""
    config: Mapping[str, Any]
    heldout: Mapping[str, Any]
    hardcore: Mapping[str, Any] | None
    """On the hardcore terrain; None if the policy's outputs are no walker's."""
    episodes: int
    """That the search or the training took; those that choose and score a champion are not counted."""
    steps: int
    generations: int
    nodes: int
    """Of the network in use: canonical form of a controller, neat-python's pruned form of a float network. Inputs do not count."""
    links: int
    packed_bytes: int | None
    """None for float networks."""
    float_bytes: int | None
    """Four for each weight and bias of a float network."""
    paper_max: float | None = None
    """As the paper counts: the largest fitness in the last generation."""
    paper_nodes: int | None = None
    """As the paper counts: inputs and all nodes of that generation's best genome."""
    paper_links: int | None = None
    """As the paper counts: enabled links of that genome, weights of zero included."""
    history: Mapping[str, Any] = field(default_factory=dict)
    """Columns of history.csv."""
    growth: tuple[Mapping[str, Any], ...] = ()
    """The best candidate so far at some generations: ``generation`` and ``policy``."""
    policy: Mapping[str, Any] | None = None
    """The champion, as `policy_to_data` writes it; None where it would be large."""
    notes: Mapping[str, Any] = field(default_factory=dict)

    def save(self, path: Path) -> None:
        """Write the file, whole."""
        write_atomic(path, seal({"format": FORMAT, **asdict(self)}))


def load(path: Path) -> Result:
    """Read a result.

    Raises:
        BitneatError: if the file is damaged.
    """
    data = unseal(
        read_capped(path, _MAX_BYTES, regular=True), str(path), required=False
    )  # results of before lack the seal
    known = {entry.name for entry in fields(Result)}
    if not isinstance(data, dict) or data.pop("format", None) != FORMAT or not set(data) <= known:
        raise BitneatError(f"{path}: expected a result of bitneat reproduce ('format': {FORMAT!r})")
    try:
        return Result(**{**data, "growth": tuple(data.get("growth", ()))})
    except TypeError as error:
        raise BitneatError(f"{path}: damaged: {error}") from None


def load_all(folder: Path) -> dict[str, Result]:
    """Every result in a folder, by job."""
    results = [load(path) for path in sorted(folder.glob("*.json"))] if folder.is_dir() else []
    return {result.job: result for result in results}


def policy_to_data(policy: Policy) -> dict[str, Any]:
    """Which kind it is, and its own data."""
    kind = "network" if isinstance(policy, FloatNetwork) else "controller"
    return {kind: policy.to_data()}


def policy_from_data(data: Mapping[str, Any]) -> Policy:
    """Read what `policy_to_data` wrote."""
    return network_from_data(data["network"]) if "network" in data else Controller.from_data(data["controller"])
