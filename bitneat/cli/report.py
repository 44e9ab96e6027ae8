# SPDX-License-Identifier: MIT
"""``bitneat report``: a champion as one HTML file."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bitneat.cli.arguments import add_json, whole_number
from bitneat.cli.size import target_names
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    from bitneat.champion import Champion
    from bitneat.report.page import Page, Sources
    from bitneat.report.page.recording import RecordedEpisode

HELP = "write one HTML file: the walk, the controller at work, its C in the browser, sizes, verdicts, provenance"
DESCRIPTION = """\
Writes a page that needs no network and opens from the disk: recorded episodes
to play, the controller's graph with the values of every step, the generated C
compiled to WebAssembly and compared with the recording while one looks on."""
EXAMPLE = """\
  bitneat report runs/walker -o report.html          a run's folder: with its history
  bitneat report champion.pkl -o report.html --seeds 7,8
  bitneat report champion.pkl -o report.html --verify verify.json --compare tiny.pkl"""
FILES = """\
  RUN|CHAMPION     read: of a run history.csv, too
  FILE             with --verify, --prove, --compare: read
  FILE.html        written"""

DEFAULT_TARGETS = "host-unrolled,host-table,cortex-m0,wasm32"
MAX_SEEDS = 12
MAX_STEPS = 2000
"""Of an episode, here and in the verification: an environment may have no time limit, and the page must stay small."""
MAX_JSON_BYTES = 16 * 1024 * 1024


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``report``."""
    parser.add_argument("champion", metavar="RUN|CHAMPION", type=Path, help="a run's folder, or champion.pkl or .json")
    parser.add_argument("-o", "--output", metavar="FILE.html", type=Path, required=True, help="the page")
    parser.add_argument(
        "--seeds", metavar="S,...", type=_seeds, action=_More, help="of the episodes to show (default 0,1,2)"
    )
    parser.add_argument(
        "--targets",
        metavar="T,...",
        help=f"where to measure and verify: names with commas between, or all (default: {DEFAULT_TARGETS})",
    )
    parser.add_argument(
        "--episodes", metavar="N", type=whole_number(1, 1000), default=2, help="episodes to verify (default 2)"
    )
    parser.add_argument("--verify", metavar="FILE", type=Path, help="take the verdict of verify --json FILE instead")
    parser.add_argument("--prove", metavar="FILE", type=Path, help="show the verdict of prove --json FILE")
    parser.add_argument(
        "--compare",
        metavar="CHAMPION",
        type=Path,
        action="append",
        default=[],
        help="another champion for the chart of reward against size; may be repeated",
    )
    parser.add_argument(
        "--import",
        metavar="MODULE",
        action="append",
        default=[],
        dest="imports",
        help="let the champion's environment import MODULE, which registers it",
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Record, measure, verify, and write the page; 1 if the verification fails, which the page then says."""
    from bitneat.files import require_writable, write_atomic, write_json
    from bitneat.report.page import build_page
    from bitneat.sim.environment import allow_imports

    if args.output.is_dir():
        raise BitneatError(f"{args.output}: is a folder, expected the name of an HTML file")
    require_writable(args.output)
    allow_imports(args.imports)
    with _progress() as progress:
        sources = _sources(args, progress)
        page = build_page(sources)
    content = page.html.encode()
    write_atomic(args.output, content)
    passed = sources.verification["verdict"] == "pass"
    print(f"wrote {args.output}: {len(content):,} bytes, {len(sources.episodes)} episodes")
    print(f"verification: {'passed' if passed else 'FAILED'}")
    if args.json is not None:
        write_json(args.json, _summary(args, sources, page, len(content)))
    return 0 if passed else 1


def _sources(args: argparse.Namespace, progress: _Progress) -> Sources:
    from bitneat.champion import load, load_found
    from bitneat.report.page import Sources
    from bitneat.report.page.history import read_history
    from bitneat.report.page.recording import record
    from bitneat.verify.check import Settings, environment_of
    from bitneat.verify.size import measure_sizes
    from bitneat.verify.targets import select

    folder = args.champion if args.champion.is_dir() else None
    champion = load(args.champion) if folder is None else load_found(folder / "champion.pkl")
    history = None if folder is None else read_history(folder)
    others = [(path.stem, load(path)) for path in args.compare]
    proof = None if args.prove is None else _verdict(args.prove, "prove", champion)
    given = None if args.verify is None else _verdict(args.verify, "verify", champion)
    environment = environment_of(champion, Settings())
    targets = select(target_names(args.targets or DEFAULT_TARGETS))
    episodes = record(
        champion.controller.canonical,
        champion.action,
        environment,
        args.seeds or (0, 1, 2),
        max_steps=MAX_STEPS,
        progress=lambda episode: progress.say(_recorded(episode)),
    )
    progress.say("measuring sizes")
    sizes = measure_sizes(champion, targets, speed=True)
    verification = given if given is not None else _verified(args, champion, progress)
    return Sources(champion, environment, episodes, sizes, verification, proof, history, others)


def _verified(args: argparse.Namespace, champion: Champion, progress: _Progress) -> dict[str, Any]:
    """Verify here and now the C that the page shows; its path says nothing to a reader of the page."""
    import tempfile

    from bitneat.report.page import page_code
    from bitneat.verify.cfile import CFile
    from bitneat.verify.check import Settings, verify
    from bitneat.verify.targets import select

    progress.say("verifying the C")
    targets = select(target_names(args.targets or DEFAULT_TARGETS))
    with tempfile.TemporaryDirectory(prefix="bitneat-") as folder:
        file = CFile.write(page_code(champion), Path(folder))
        return verify(
            champion,
            file,
            targets,
            Settings(episodes=args.episodes, max_steps=MAX_STEPS),
            handed_out=False,
            note=progress.note,
        ).to_data()


def _verdict(path: Path, command: str, champion: Champion) -> Mapping[str, Any]:
    """What a command's ``--json`` wrote, if that is verify or prove as expected, and it is of this controller."""
    from bitneat.files import read_capped

    try:
        data = json.loads(read_capped(path, MAX_JSON_BYTES))
        json.dumps(data, ensure_ascii=False).encode()  # half of a surrogate pair is no text
    except (ValueError, RecursionError):
        raise BitneatError(f"{path}: not the JSON of a report") from None
    controller = data.get("controller") if isinstance(data, dict) else None
    sha256 = controller.get("sha256") if isinstance(controller, dict) else None
    if not isinstance(data, dict) or data.get("verdict") not in ("pass", "fail"):
        raise BitneatError(f"{path}: expected a report with a verdict, pass or fail")
    written = _command(data)
    if written != command:
        what = f"was written by {written} --json" if written else "is no report of verify or prove"
        raise BitneatError(f"{path}: {what}, expected one that {command} --json wrote")
    if sha256 != champion.controller.sha256:
        raise BitneatError(
            f"{path}: is of controller {str(sha256)[:12]}, the champion's is {champion.controller.sha256[:12]}"
        )
    return data


def _command(data: Mapping[str, Any]) -> str | None:
    """Which command wrote a report: it says so, and reports of before, which did not, differ in what they have."""
    kinds = {"verify": isinstance(data.get("targets"), list), "prove": isinstance(data.get("pairs"), list)}
    named = data.get("command")
    return next((kind for kind, fits in kinds.items() if fits and named in (kind, None)), None)


class _More(argparse.Action):
    """The seeds of an option that is given again are seeds, too."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        seeds = tuple(dict.fromkeys((*(getattr(namespace, self.dest) or ()), *values)))
        if len(seeds) > MAX_SEEDS:
            raise argparse.ArgumentError(self, f"expected 1 to {MAX_SEEDS} whole numbers in all, got {len(seeds)}")
        setattr(namespace, self.dest, seeds)


def _seeds(text: str) -> tuple[int, ...]:
    try:
        seeds = tuple(dict.fromkeys(int(part) for part in text.split(",")))
    except ValueError:
        seeds = ()
    if not 1 <= len(seeds) <= MAX_SEEDS or not all(0 <= seed < 2**31 for seed in seeds):
        raise argparse.ArgumentTypeError(f"{text!r} is not 1 to {MAX_SEEDS} whole numbers in 0..{2**31 - 1}")
    return seeds


def _recorded(episode: RecordedEpisode) -> str:
    return f"recorded seed {episode.seed}: {episode.steps} steps, reward {episode.reward:.1f}"


@dataclass(frozen=True)
class _Progress:
    """What is done now, on stderr: ``say`` for what takes long, ``note`` for the parts of it."""

    say: Callable[[str], None]
    note: Callable[[str], None]


@contextmanager
def _progress() -> Iterator[_Progress]:
    """One line that changes on a terminal; elsewhere a line for each of what is said, and none for the notes."""
    if not sys.stderr.isatty():
        yield _Progress(lambda text: print(text, file=sys.stderr, flush=True), lambda text: None)
        return
    from rich.console import Console
    from rich.markup import escape

    with Console(stderr=True).status("starting") as status:

        def show(text: str) -> None:
            status.update(escape(text))

        yield _Progress(show, show)


def _summary(args: argparse.Namespace, sources: Sources, page: Page, size: int) -> dict[str, Any]:
    import hashlib

    return {
        "page": str(args.output),
        "bytes": size,
        "sha256": hashlib.sha256(page.html.encode()).hexdigest(),
        "controller": sources.champion.controller.sha256,
        "c_sha256": hashlib.sha256(page.code.source.encode()).hexdigest(),
        "episodes": [
            {"seed": episode.seed, "steps": episode.steps, "reward": episode.reward} for episode in sources.episodes
        ],
        "verdict": sources.verification["verdict"],
    }
