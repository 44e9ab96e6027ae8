# SPDX-License-Identifier: MIT
"""``bitneat import``: a champion from a genome that plain neat-python pickled."""

from __future__ import annotations

import argparse
from pathlib import Path

from bitneat.cli.arguments import whole_number
from bitneat.errors import BitneatError

HELP = "make a champion from a genome pickled by plain neat-python"
EXAMPLE = "  bitneat import winner.pkl --config neat.ini --env CartPole-v1 -o champion.pkl"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``import``."""
    parser.add_argument("genome", metavar="GENOME", type=Path, help="a pickled genome; its weights must be integers")
    parser.add_argument(
        "--config", metavar="FILE", type=Path, required=True, help="the genome's neat-python configuration"
    )
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, default=Path("champion.pkl"), help="default champion.pkl"
    )
    parser.add_argument("--env", metavar="ID", help="the environment it was evolved in: gives limits and actions")
    parser.add_argument(
        "--import", metavar="MODULE", action="append", dest="imports", help="import MODULE, which registers ID"
    )
    parser.add_argument(
        "--frac-bits", metavar="F", type=whole_number(4, 12), default=8, help="fractional bits (default 8)"
    )


def run(args: argparse.Namespace) -> int:
    """Read, convert, write."""
    from bitneat.champion import Champion, EnvironmentSpec, save_json, save_pickle
    from bitneat.controller import Action, BoxAction, Input
    from bitneat.evolve.importing import convert, read_genome, read_shape
    from bitneat.version import __version__

    shape = read_shape(args.config)
    genome = read_genome(args.genome)
    spec = None
    action: Action = BoxAction((-1.0,) * shape.num_outputs, (1.0,) * shape.num_outputs, (shape.num_outputs,), "float32")
    inputs: tuple[Input, ...] = (Input(),) * shape.num_inputs
    if args.env is not None:
        from bitneat.sim.environment import allow_imports, default_inputs, inspect

        allow_imports(args.imports or ())
        spec = EnvironmentSpec(args.env, {}, tuple(args.imports or ()))
        info = inspect(spec)
        if (info.num_inputs, info.action.num_outputs) != (shape.num_inputs, shape.num_outputs):
            raise BitneatError(
                f"{args.config}: has {shape.num_inputs} inputs and {shape.num_outputs} outputs,"
                f" {args.env} needs {info.num_inputs} and {info.action.num_outputs}"
            )
        # The genome saw observations as they are, so that no input is scaled beyond the resolution of signals.
        inputs, action = default_inputs(info, args.frac_bits, (0,) * shape.num_inputs), info.action
    try:
        controller = convert(genome, shape, inputs, args.frac_bits)
    except BitneatError as error:
        raise BitneatError(f"{args.genome}: {error}") from None
    champion = Champion(controller, action, spec, {"tool": f"bitneat {__version__}", "imported": "neat-python"})
    if args.output.suffix == ".json":
        save_json(champion, args.output)
    else:
        save_pickle(champion, args.output)
    kind = "ternary" if controller.is_ternary else "integer"
    print(f"{args.output}: {kind}, {len(controller.nodes)} nodes, {controller.num_links} links")
    return 0
