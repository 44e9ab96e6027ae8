# SPDX-License-Identifier: MIT
"""``bitneat render``: an episode as a film or a strip of pictures."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bitneat.cli.arguments import add_json, whole_number
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    from bitneat.champion import AnyChampion
    from bitneat.network import Policy
    from bitneat.report.pictures import Episode, Moment

HELP = "record an episode as .gif, .mp4 or a strip of pictures (needs bitneat[render])"
DESCRIPTION = """\
Records an episode in Gymnasium, with generation, reward and step on every
picture. The bytes depend on the arguments and on the versions of the packages
that draw and encode."""
EXAMPLE = """\
  bitneat render champion.pkl -o walk.gif
  bitneat render champion.pkl -o walk.mp4 --seed 3 --hardcore
  bitneat render champion.pkl -o walk.png --frames 8"""
FILES = """\
  CHAMPION         read
  FILE             written: .gif, .mp4 or .png"""

_SMOOTH = 16
"""Pictures a second that a GIF has at least, if the environment has as many steps."""
_SLOWEST = 0.01
"""Pictures a second, at least: a GIF has 655 seconds a picture at most."""
_WIDTHS = {"gif": 400, "mp4": 600, "png": 240}
_FRAMES = 6


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``render``."""
    parser.add_argument(
        "champion", nargs="?", type=Path, default=Path("champion.pkl"), help="champion.pkl or champion.json"
    )
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, required=True, help="a .gif, .mp4 or .png file; .png is a strip"
    )
    parser.add_argument("--seed", metavar="S", type=whole_number(0), default=0, help="of the episode (default 0)")
    parser.add_argument(
        "--steps", metavar="N", type=whole_number(1), help="stop after N steps (default: the episode's end)"
    )
    parser.add_argument(
        "--every",
        metavar="N",
        type=whole_number(1),
        help=f"a picture each N steps (default: 1; of a .gif, so many that {_SMOOTH} or so are seen a second)",
    )
    parser.add_argument("--fps", metavar="N", type=float, help="pictures a second (default: as fast as it would be)")
    parser.add_argument(
        "--frames",
        metavar="N",
        type=whole_number(1, 100),
        help=f"pictures of a .png, evenly spaced (default {_FRAMES})",
    )
    parser.add_argument(
        "--width",
        metavar="PIXELS",
        type=whole_number(16, 4096),
        help="of a picture (default {gif} of a .gif, {mp4} of an .mp4, {png} of each in a .png)".format(**_WIDTHS),
    )
    parser.add_argument("--hardcore", action="store_true", help="run BipedalWalkerHardcore-v3 instead")
    parser.add_argument(
        "--import",
        metavar="MODULE",
        action="append",
        dest="imports",
        help="import MODULE, which registers the environment",
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Run the episode, and write its pictures."""
    from bitneat.champion import load_any
    from bitneat.files import require_writable, write_atomic, write_json
    from bitneat.report import film, pictures
    from bitneat.sim.environment import allow_imports

    kind = _kind(args)
    require_writable(args.output)
    film.require_pillow()
    if kind == "mp4":
        film.require_ffmpeg()
    allow_imports(args.imports or ())
    champion = load_any(args.champion)
    episode = _episode(args, champion)
    speed = pictures.steps_per_second(episode.spec)
    width = args.width or _WIDTHS[kind]
    if kind == "png":
        taken = pictures.spread(episode, args.frames or _FRAMES)
        last, every, fps = taken[-1], None, None
        content = film.strip(taken, width, f"{episode.spec.id}, seed {episode.seed}")
        count = len(taken)
    else:
        every = args.every or (max(round(speed / _SMOOTH), 1) if kind == "gif" else 1)
        fps = args.fps or max(speed / every, _SLOWEST)
        frames = []
        with _shown() as show:
            for last in pictures.moments(episode, lambda step: step % every == 0):
                if last.image is not None:
                    frames.append(film.frame(last, width, _generation(champion)))
                show(last)
        content = film.gif(frames, fps) if kind == "gif" else film.mp4(frames, fps)
        count = len(frames)
    write_atomic(args.output, content)
    print(
        f"wrote {args.output}: {count} pictures of {last.step} steps, reward {last.reward:.1f}, {len(content) / 1e6:.2f} MB"
    )
    if args.json is not None:
        summary = {
            "file": str(args.output),
            "bytes": len(content),
            "environment": episode.spec.id,
            "seed": episode.seed,
            "steps": last.step,
            "reward": last.reward,
            "pictures": count,
            "every": every,
            "fps": fps,
        }
        write_json(args.json, summary)
    return 0


def _kind(args: argparse.Namespace) -> str:
    suffix = args.output.suffix.lower().lstrip(".")
    if suffix not in _WIDTHS:
        raise BitneatError(f"{args.output}: expected a name that ends in .gif, .mp4 or .png")
    if args.fps is not None and not _SLOWEST <= args.fps <= 1000:
        raise BitneatError(f"--fps {args.fps:g}: expected a number in {_SLOWEST}..1000")
    wrong = ("every", "fps") if suffix == "png" else ("frames",)
    for option in wrong:
        if getattr(args, option) is not None:
            raise BitneatError(f"--{option}: not of a .{suffix}; a .png has --frames pictures, evenly spaced")
    return str(suffix)


def _episode(args: argparse.Namespace, champion: AnyChampion) -> Episode:
    from bitneat.champion import Champion, EnvironmentSpec
    from bitneat.report.pictures import Episode
    from bitneat.sim.environment import inspect

    spec = EnvironmentSpec("BipedalWalkerHardcore-v3") if args.hardcore else champion.environment
    if spec is None:
        raise BitneatError(f"{args.champion}: names no environment to run in")
    info = inspect(spec)
    policy: Policy
    if isinstance(champion, Champion):
        policy, inputs = champion.controller, len(champion.controller.inputs)
    else:
        policy, inputs = champion.network, champion.network.num_inputs
    if (inputs, champion.action) != (info.num_inputs, info.action):
        raise BitneatError(f"{args.champion}: does not fit {spec.id}: other inputs or another action")
    limit = champion.provenance.get("max_steps")
    limits = [n for n in (args.steps, info.max_steps, limit) if type(n) is int and n > 0]
    if not limits:
        raise BitneatError(f"environment {spec.id}: has no time limit; give --steps")
    return Episode(spec, policy, champion.action, args.seed, min(limits))


def _generation(champion: AnyChampion) -> int | None:
    """In which the search found it, or how many it took, as far as the file says."""
    for key in ("generation", "generations"):
        value: Any = champion.provenance.get(key)
        if type(value) is int:
            return value
    return None


@contextmanager
def _shown() -> Iterator[Any]:
    """The step and the reward while they come, on a terminal."""
    if not sys.stderr.isatty():
        yield lambda moment: None
        return
    from rich.console import Console
    from rich.status import Status

    with Status("recording", console=Console(stderr=True)) as status:

        def show(moment: Moment) -> None:
            if moment.step % 10 == 0:
                status.update(f"recording: step {moment.step}, reward {moment.reward:.1f}")

        yield show
