# SPDX-License-Identifier: MIT
"""What a run came to, as plain data in a JSON file of its own: all that tables and figures are made from."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
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


def _is_whole(value: Any) -> bool:
    return type(value) is int and value >= 0


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) <= sys.float_info.max  # no NaN either


def _is_score(value: Any) -> bool:
    return (
        isinstance(value, dict)
        and {"episodes", "mean", "std", "min", "max"} <= set(value)
        and _is_whole(value["episodes"])
        and all(map(_is_number, value.values()))
    )


def _is_policy(value: Any) -> bool:
    return isinstance(value, dict) and any(isinstance(value.get(kind), dict) for kind in ("network", "controller"))


def _is_history(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(c, list) and all(map(_is_number, c)) for c in value.values())


def _is_growth(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(entry, dict) and _is_whole(entry.get("generation")) and _is_policy(entry.get("policy"))
        for entry in value
    )


def _are_notes(value: Any) -> bool:
    return (
        isinstance(value, dict)
        and isinstance(value.get("how", {}), dict)
        and all(_is_score(value[name]) for name in ("before", "selection", "library_held_out") if name in value)
    )


def _or_none(is_right: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: value is None or is_right(value)


_TEXT = (lambda value: isinstance(value, str), "text")
_WHOLE = (_is_whole, "a whole number from 0")
_WHOLE_OR_NULL = (_or_none(_is_whole), "a whole number from 0, or null")
_SCORE = "a score: episodes, mean, std, min, max"
_EXPECTED: Mapping[str, tuple[Callable[[Any], bool], str]] = {
    **dict.fromkeys(("job", "group", "system", "command"), _TEXT),
    **dict.fromkeys(("seed", "episodes", "steps", "generations", "nodes", "links"), _WHOLE),
    **dict.fromkeys(("packed_bytes", "float_bytes", "paper_nodes", "paper_links"), _WHOLE_OR_NULL),
    "paper_max": (_or_none(_is_number), "a number, or null"),
    "config": (lambda value: isinstance(value, dict), "an object"),
    "heldout": (_is_score, _SCORE),
    "hardcore": (_or_none(_is_score), f"{_SCORE}; or null"),
    "history": (_is_history, "columns of numbers"),
    "growth": (_is_growth, "a list of generations and policies"),
    "policy": (_or_none(_is_policy), "a network or a controller, or null"),
    "notes": (_are_notes, "an object of scores and how the result was made"),
}
"""What a file must have in each field for all that reads it later."""


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
    for name, (is_right, expected) in _EXPECTED.items():
        if name in data and not is_right(data[name]):
            raise BitneatError(f"{path}: damaged: {name}: expected {expected}")
    try:
        return Result(**{**data, "growth": tuple(data.get("growth", ()))})
    except TypeError as error:  # a key is missing
        raise BitneatError(f"{path}: damaged: {error}") from None


def load_all(folder: Path) -> dict[str, Result]:
    """Every result in a folder, by job.

    Raises:
        BitneatError: if a file is damaged, or has another name than its job's, as a copy of it has: it would count in its place.
    """
    results = {}
    for path in sorted(folder.glob("*.json")) if folder.is_dir() else ():
        result = load(path)
        if path.stem != result.job:
            raise BitneatError(
                f"{path}: is the result of {result.job!r:.80}; expected it in a file of that name: remove or rename it"
            )
        results[result.job] = result
    return results


def policy_to_data(policy: Policy) -> dict[str, Any]:
    """Which kind it is, and its own data."""
    kind = "network" if isinstance(policy, FloatNetwork) else "controller"
    return {kind: policy.to_data()}


def policy_from_data(data: Mapping[str, Any]) -> Policy:
    """Read what `policy_to_data` wrote."""
    return network_from_data(data["network"]) if "network" in data else Controller.from_data(data["controller"])
