# SPDX-License-Identifier: MIT
"""``bitneat codegen``: a champion's C source and header."""

from __future__ import annotations

import argparse
from pathlib import Path

from bitneat.cli.arguments import add_json
from bitneat.errors import BitneatError

HELP = "write a champion as C that only adds and subtracts"
EXAMPLE = """  bitneat codegen champion.pkl -o walker.c
  bitneat codegen champion.pkl -o build/legs.c --name legs --style table --guard --selftest"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``codegen``."""
    parser.add_argument("champion", type=Path, help="champion.pkl or champion.json")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE.c", help="the source; the header goes beside it"
    )
    parser.add_argument("--name", help="prefix of every C name (default: the name of FILE)")
    parser.add_argument(
        "--style",
        choices=("auto", "unrolled", "table"),
        default="auto",
        help="straight-line code, a table with an interpreter, or the smaller as compiled (default: auto)",
    )
    parser.add_argument(
        "--guard", action="store_true", help="clamp observations to their limits, so that any int16 is allowed"
    )
    parser.add_argument("--selftest", action="store_true", help="also write NAME_selftest.c with known answers")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Generate and write the files."""
    from bitneat import champion as champions
    from bitneat.codegen import generate, selftest
    from bitneat.codegen.names import check_file_stem, check_name
    from bitneat.files import write_atomic, write_json

    output: Path = args.output
    if output.suffix != ".c" or output.is_dir():
        raise BitneatError(f"{output}: expected a file name that ends in .c")
    check_file_stem(output.stem, "-o")
    if args.name is None:
        name = check_name(output.stem, f"{output} (choose another with --name)")
    else:
        name = check_name(args.name, "--name")
    champion = champions.load(args.champion)
    code = generate(
        champion.controller,
        name,
        args.style,
        guard=args.guard,
        action=champion.action,
        environment_id=champion.environment.id if champion.environment else "",
        header_name=f"{output.stem}.h",
    )
    files = {output.with_suffix(".h"): code.header, output: code.source}
    if args.selftest:
        files[output.with_name(f"{output.stem}_selftest.c")] = selftest(code, champion.controller)
    if args.json in files or args.json == args.champion:
        raise BitneatError(f"--json {args.json}: is another file of this command")
    for path, text in files.items():
        write_atomic(path, text.encode("ascii"))
    written = ", ".join(str(path) for path in files)
    encoding = f", encoding {code.encoding}" if code.encoding else ""
    print(
        f"{written}: style {code.style}{encoding}, {code.table_bytes} table bytes, controller {champion.controller.sha256[:12]}"
    )
    if args.json:
        write_json(
            args.json,
            {
                "sha256": champion.controller.sha256,
                "name": name,
                "style": code.style,
                "encoding": code.encoding,
                "table_bytes": code.table_bytes,
                "files": [str(path) for path in files],
            },
        )
    return 0
