# SPDX-License-Identifier: MIT
"""The figure of champions: held-out reward against packed bytes, and which of them none other beats in both."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from bitneat.champion import FLOAT_FORMAT, FORMAT, Champion, EnvironmentSpec, load_any
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.report import figure
from bitneat.report.figure import BLUE, GREY
from bitneat.reproduce.results import FORMAT as RESULT_FORMAT
from bitneat.reproduce.results import load as load_result
from bitneat.reproduce.results import policy_from_data

WALKER = EnvironmentSpec("BipedalWalker-v3")
"""What ``bitneat reproduce`` evolves in."""
_SUFFIXES = (".pkl", ".json")
_MAX_FILES = 2000
_PEEK = 4096
_LABELS = 8
"""So many points get their names; of more, those on the front alone."""


@dataclass(frozen=True)
class Point:
    """A champion with a held-out score."""

    name: str
    sha256: str
    packed_bytes: int
    mean: float
    std: float
    environment: EnvironmentSpec | None


@dataclass(frozen=True)
class Collection:
    """What some paths hold: the points, each controller once, and why champions are left out."""

    points: tuple[Point, ...]
    left_out: tuple[str, ...]


def collect(paths: Sequence[Path]) -> Collection:
    """All champions in files, run folders, and folders of such, and those in the results of ``bitneat reproduce``.

    A file that is named must be a champion; in folders, files of other kinds are passed over. A champion without a held-out
    score, or with float weights, which have no packed form, is left out.

    Raises:
        BitneatError: if a file cannot be read, or nothing is left to draw.
    """
    points: dict[str, Point] = {}
    left_out = []
    for path in paths:
        for file in _champion_files(path):
            found = _read(file, _name(file, path))
            if isinstance(found, str):
                left_out.append(f"{file}: {found}")
            elif found.sha256 not in points:
                points[found.sha256] = found
    if not points:
        reason = f" ({left_out[0]})" if left_out else ""
        raise BitneatError(f"plot pareto: found no champion with packed bytes and a held-out score{reason}")
    return Collection(tuple(points.values()), tuple(left_out))


def of_one_environment(found: Collection, environment_id: str | None = None) -> Collection:
    """The points of one environment, since rewards of several cannot be compared; the others are left out.

    Args:
        found: any points.
        environment_id: the environment; if not given, that of most of them.

    Raises:
        BitneatError: if there is no point of it.
    """
    ids = Counter(point.environment.id if point.environment else "no environment" for point in found.points)
    chosen = ids.most_common(1)[0][0] if environment_id is None else environment_id
    if chosen not in ids:
        raise BitneatError(f"--env {chosen}: found no champion for it, only for {', '.join(sorted(ids))}")
    kept = tuple(p for p in found.points if chosen == (p.environment.id if p.environment else "no environment"))
    others = tuple(
        f"{count} champion{'s' if count > 1 else ''} for {name}"
        for name, count in sorted(ids.items())
        if name != chosen
    )
    return Collection(kept, (*found.left_out, *others))


def front(points: Iterable[Point]) -> list[Point]:
    """Those that none other beats in one of reward and bytes without being worse in the other; by bytes."""
    best = -math.inf
    kept = []
    for point in sorted(points, key=lambda p: (p.packed_bytes, -p.mean, p.sha256)):
        if point.mean > best:
            best = point.mean
            kept.append(point)
    return kept


def pareto_figure(points: Sequence[Point], references: Sequence[float], file_type: str) -> bytes:
    """The figure as SVG or PNG.

    Raises:
        BitneatError: if Matplotlib is not installed.
    """
    best = front(points)
    with figure.settings():
        from matplotlib.figure import Figure
        from matplotlib.ticker import NullFormatter, ScalarFormatter

        page = Figure(figsize=(7.0, 4.0), layout="constrained")
        axes = page.add_subplot()
        axes.step(
            [p.packed_bytes for p in best], [p.mean for p in best], where="post", color=BLUE, linewidth=1.2, zorder=1
        )
        for members, colour, label in (
            (best, BLUE, "the front"),
            ([p for p in points if p not in best], GREY, "others"),
        ):
            if members:
                axes.errorbar(
                    [p.packed_bytes for p in members], [p.mean for p in members], yerr=[p.std for p in members],
                    fmt="o", markersize=4, color=colour, elinewidth=0.8, capsize=2.5, label=f"{label} (± std)", zorder=2,
                )  # fmt: skip
        named = sorted(points if len(points) <= _LABELS else best, key=lambda p: (p.packed_bytes, p.mean))
        for place, point in enumerate(named):  # above and below in turn, as neighbours are often close
            axes.annotate(
                f"{point.name}: {point.packed_bytes} bytes", (point.packed_bytes, point.mean), fontsize=7.5,
                textcoords="offset points", xytext=(5, 5 if place % 2 == 0 else -11),
                color="black" if point in best else GREY,
            )  # fmt: skip
        sizes = [p.packed_bytes for p in points]
        if max(sizes) > 8 * min(sizes):
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter(ScalarFormatter())
            axes.xaxis.set_minor_formatter(NullFormatter())
        for reference in references:
            figure.reference_line(axes, reference)
        axes.margins(x=0.15)
        axes.set_xlabel("packed bytes: topology, weights, activations, all")
        axes.set_ylabel("held-out reward")
        axes.grid(visible=True)
        axes.legend(frameon=False, loc="lower right")
        return figure.render(page, file_type, "bitneat: reward against size", f"{len(points)} champions")


def _champion_files(path: Path) -> Iterator[Path]:
    if not path.is_dir():
        yield path
        return
    found = sorted(file for suffix in _SUFFIXES for file in path.rglob(f"*{suffix}") if file.is_file())
    if len(found) > _MAX_FILES:
        raise BitneatError(
            f"{path}: holds {len(found)} files of the endings {', '.join(_SUFFIXES)}, too many to look into"
        )
    yield from (file for file in found if _is_champion(file))


def _is_champion(file: Path) -> bool:
    """By its first bytes: checkpoints can be large."""
    with file.open("rb") as stream:
        start = stream.read(_PEEK)
    return any(name.encode() in start for name in (FORMAT, FLOAT_FORMAT, RESULT_FORMAT))


def _name(file: Path, given: Path) -> str:
    """Of a run's champion the run, of any other file the file."""
    stem = file.stem
    if stem != "champion":
        return stem
    return (file.parent if given.is_dir() else file.absolute().parent).resolve().name


def _read(file: Path, name: str) -> Point | str:
    """A point, or why there is none."""
    with file.open("rb") as stream:
        is_result = RESULT_FORMAT.encode() in stream.read(_PEEK)
    if is_result:
        result = load_result(file)
        sha256 = str(result.policy and policy_from_data(result.policy).sha256)
        return _point(result.job, sha256, result.packed_bytes, result.heldout, WALKER)
    champion = load_any(file)
    score = champion.provenance.get("held_out")
    if isinstance(champion, Champion):
        controller = champion.controller
        return _point(name, controller.sha256, len(pack(controller)), score, champion.environment)
    return _point(name, champion.network.sha256, None, score, champion.environment)


def _point(
    name: str, sha256: str, packed_bytes: int | None, score: Any, environment: EnvironmentSpec | None
) -> Point | str:
    if packed_bytes is None:
        return "float weights have no packed form"
    if not isinstance(score, Mapping):
        return "has no held-out score"
    mean, std = (score.get(key) for key in ("mean", "std"))
    if not (_is_number(mean) and _is_number(std)):
        return "its held-out score is no number"
    return Point(name, sha256, packed_bytes, float(mean), float(std), environment)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
