# SPDX-License-Identifier: MIT
"""``bitneat import``: a champion from a genome or a policy that other software made."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bitneat.cli.arguments import add_json, whole_number
from bitneat.cli.quantize import add_method, make_champion
from bitneat.cli.simulator import add_simulator
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    from bitneat.champion import AnyChampion, EnvironmentSpec, FloatChampion
    from bitneat.controller import Action
    from bitneat.sim.environment import EnvironmentInfo

HELP = "make a champion from a neat-python genome, a stable-baselines3 model or layers in a .npz file"
DESCRIPTION = """\
Reads a policy that something else trained and writes it as a champion. Nothing
in the file is executed. A genome whose weights and biases are integers, and its
responses powers of two, becomes a controller; every other genome, a model and
layers, whatever their numbers, a float champion, of which --to or `bitneat
quantize` makes a controller."""
EXAMPLE = """\
  bitneat import winner.pkl --config neat.ini --env CartPole-v1 -o champion.pkl
  bitneat import ars.zip --env BipedalWalker-v3 -o float.pkl
  bitneat import layers.npz --activation tanh --env BipedalWalker-v3 --to ternary -o champion.pkl"""
FILES = """\
  FILE             read
  INI, NPZ         read, if --config or --normalization names them
  champion.pkl     written, or what -o names"""

_FUNCTIONS = ("tanh", "relu", "identity", "clamped", "sigmoid")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``import``."""
    parser.add_argument(
        "file",
        metavar="FILE",
        type=Path,
        help="a pickled genome, a model that stable-baselines3 saved, or a .npz file with W1, b1, W2, b2, …",
    )
    reading = parser.add_argument_group("reading the file")
    reading.add_argument("--config", metavar="INI", type=Path, help="of a genome: its neat-python configuration")
    reading.add_argument(
        "--float",
        action="store_true",
        dest="as_float",
        help="of a genome with integer weights: a float champion all the same",
    )
    reading.add_argument("--activation", choices=_FUNCTIONS, help="of hidden layers (npz: default tanh; zip: as saved)")
    reading.add_argument(
        "--output-activation", choices=_FUNCTIONS, help="of the last layer of a .npz file (default identity)"
    )
    reading.add_argument(
        "--normalization", metavar="NPZ", type=Path, help="mean and var that observations were normalized with"
    )
    environment = parser.add_argument_group("environment")
    environment.add_argument("--env", metavar="ID", help="the environment it was trained in: gives limits and actions")
    environment.add_argument(
        "--import", metavar="MODULE", action="append", dest="imports", help="import MODULE, which registers ID"
    )
    controller = parser.add_argument_group("the controller")
    controller.add_argument(
        "--frac-bits", metavar="F", type=whole_number(4, 12), default=8, help="fractional bits (default 8)"
    )
    controller.add_argument("--to", choices=("int", "ternary"), help="quantize it at once, as `bitneat quantize` does")
    add_method(controller)
    running = parser.add_argument_group("how episodes run, which changes no result")
    add_simulator(running)
    results = parser.add_argument_group("results")
    results.add_argument(
        "-o", "--output", metavar="FILE", type=Path, default=Path("champion.pkl"), help="default champion.pkl"
    )
    add_json(results)


def run(args: argparse.Namespace) -> int:
    """Read, convert, write."""
    from bitneat.champion import Champion
    from bitneat.files import require_writable, write_json
    from bitneat.sim.environment import allow_imports

    allow_imports(args.imports or ())
    if args.to is None:
        if args.method is not None:
            raise BitneatError("--method: only with --to")
        for option, value in {"--generations": args.generations, "--seed": args.seed}.items():
            if value is not None:
                raise BitneatError(f"{option}: only with --to and --method search")
    require_writable(args.output)
    champion = _genome(args) if _kind(args.file) == "genome" else _layers(args)
    if args.to is None or (args.to == "int" and isinstance(champion, Champion)):
        summary = _write(champion, args.output)
    else:
        summary = make_champion(champion, args, args.frac_bits, str(args.file))
    if args.json is not None:
        write_json(args.json, summary)
    return 0


def _write(champion: AnyChampion, output: Path) -> dict[str, Any]:
    """Write the champion, and say and give what it is."""
    from bitneat.champion import Champion, save_json, save_pickle
    from bitneat.cli.outcome import controller_data

    (save_json if output.suffix == ".json" else save_pickle)(champion, output)
    if isinstance(champion, Champion):
        data = controller_data(champion.controller)
        kind = "ternary" if data["ternary"] else "integer"
    else:
        network = champion.network
        data = {"sha256": network.sha256, "nodes": len(network.nodes), "links": network.num_links}
        kind = "float"
    print(f"{output}: {kind}, {data['nodes']} nodes, {data['links']} links")
    if kind == "float":
        print(f"a controller of it makes: bitneat quantize {output} -o OUT --to ternary")
    return {"champion": str(output), "kind": kind, **data}


def _kind(path: Path) -> str:
    """What a file holds, by its first bytes and its members: "genome", "model" or "arrays"."""
    from bitneat.files import read_capped
    from bitneat.policy.archive import MAX_FILE_BYTES, Archive
    from bitneat.policy.layers import PolicyError
    from bitneat.policy.stable_baselines import POLICY_MEMBER

    content = read_capped(path, MAX_FILE_BYTES, regular=True)  # it is read again, which a pipe cannot be
    if not content.startswith(b"PK"):
        other = _no_genome(content)
        if other is not None:
            raise BitneatError(f"{path}: {other}")
        return "genome"
    try:
        return "model" if POLICY_MEMBER in Archive(content).names else "arrays"
    except PolicyError as error:
        raise BitneatError(f"{path}: {error}") from None


def _no_genome(content: bytes) -> str | None:
    """What a file is that no one can mean for a pickled genome, and what was expected; None if it may be one."""
    from bitneat.champion import loads_any

    expected = "expected a genome's pickle, a model's .zip, or layers in a .npz"
    if not content:
        return f"is empty, {expected}"
    if content.startswith(b"\x93NUMPY"):
        return f"is a single array of NumPy's, {expected}, as numpy.savez writes them"
    try:
        loads_any(content)
    except BitneatError:
        pass
    else:
        return "is a champion of bitneat's already; bitneat quantize makes another kind of it"
    # The oldest pickles are text, too; every pickle ends with a full stop.
    return f"is text, {expected}" if content.rstrip().isascii() and not content.endswith(b".") else None


def _environment(args: argparse.Namespace) -> tuple[EnvironmentSpec, EnvironmentInfo] | None:
    from bitneat.champion import EnvironmentSpec
    from bitneat.sim.environment import inspect

    if args.env is None:
        return None
    spec = EnvironmentSpec(args.env, {}, tuple(args.imports or ()))
    return spec, inspect(spec)


def _unit_actions(count: int) -> Action:
    """Of a policy without an environment."""
    from bitneat.controller import BoxAction

    return BoxAction((-1.0,) * count, (1.0,) * count, (count,), "float32")


def _genome(args: argparse.Namespace) -> AnyChampion:
    from bitneat.champion import Champion, FloatChampion
    from bitneat.controller import Input
    from bitneat.evolve.importing import convert, convert_float, is_whole, read_genome, read_shape
    from bitneat.sim.environment import default_inputs
    from bitneat.version import __version__

    if args.config is None:
        raise BitneatError(f"{args.file}: to import a genome, name its neat-python configuration with --config")
    for option, value in {
        "--activation": args.activation,
        "--output-activation": args.output_activation,
        "--normalization": args.normalization,
    }.items():
        if value is not None:
            raise BitneatError(f"{option}: not for a genome, which brings its own")
    shape = read_shape(args.config)
    genome = read_genome(args.file)
    found = _environment(args)
    action = _unit_actions(shape.num_outputs)
    inputs: tuple[Input, ...] = (Input(),) * shape.num_inputs
    if found is not None:
        info = found[1]
        if (info.num_inputs, info.action.num_outputs) != (shape.num_inputs, shape.num_outputs):
            raise BitneatError(
                f"{args.config}: has {shape.num_inputs} inputs and {shape.num_outputs} outputs,"
                f" {args.env} needs {info.num_inputs} and {info.action.num_outputs}"
            )
        # The genome saw observations as they are, so that no input is scaled beyond the resolution of signals.
        inputs, action = default_inputs(info, args.frac_bits, (0,) * shape.num_inputs), info.action
    environment = None if found is None else found[0]
    provenance = {"tool": f"bitneat {__version__}", "imported": "neat-python"}
    whole = is_whole(genome)
    if not whole and not args.as_float:
        print(
            "bitneat: its weights, biases or responses are no integers or powers of two: imported as a float network",
            file=sys.stderr,
        )
    try:
        if args.as_float or not whole:
            return FloatChampion(convert_float(genome, shape), action, environment, provenance)
        return Champion(convert(genome, shape, inputs, args.frac_bits), action, environment, provenance)
    except BitneatError as error:
        raise BitneatError(f"{args.file}: {error}") from None


def _layers(args: argparse.Namespace) -> FloatChampion:
    """The float champion of a saved model or of arrays."""
    from bitneat.champion import FloatChampion
    from bitneat.files import read_capped
    from bitneat.policy import arrays, stable_baselines
    from bitneat.policy.archive import MAX_FILE_BYTES
    from bitneat.policy.layers import layered_network, with_normalization
    from bitneat.version import __version__

    model = _kind(args.file) == "model"
    if args.config is not None or args.as_float:
        raise BitneatError(f"{args.file}: is no genome, which --config and --float are for")
    if model and args.env is None:
        raise BitneatError(f"{args.file}: to import a model, name its environment with --env")
    if model and args.output_activation is not None:
        raise BitneatError("--output-activation: not for a model of stable-baselines3, which brings its own")
    found = _environment(args)
    normalization = None if args.normalization is None else arrays.read_normalization(args.normalization)
    content = read_capped(args.file, MAX_FILE_BYTES)
    try:
        if model:
            assert found is not None
            layers = stable_baselines.read_layers(content, found[1].action, args.activation)
        else:
            layers = arrays.read_layers(content, args.activation or "tanh", args.output_activation or "identity")
        if normalization is not None:
            layers = with_normalization(layers, *normalization)
        network = layered_network(layers)
    except BitneatError as error:
        raise BitneatError(f"{args.file}: {error}") from None
    action = _unit_actions(len(network.outputs))
    if found is not None:
        info = found[1]
        if (info.num_inputs, info.action.num_outputs) != (network.num_inputs, len(network.outputs)):
            raise BitneatError(
                f"{args.file}: has {network.num_inputs} inputs and {len(network.outputs)} outputs,"
                f" {args.env} needs {info.num_inputs} and {info.action.num_outputs}"
            )
        action = info.action
    provenance = {"tool": f"bitneat {__version__}", "imported": "stable-baselines3" if model else "npz"}
    return FloatChampion(network, action, None if found is None else found[0], provenance)
