# SPDX-License-Identifier: MIT
"""``bitneat codegen``: a champion's C source and header."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bitneat.cli.arguments import add_json
from bitneat.errors import BitneatError

if TYPE_CHECKING:
    from bitneat.champion import Champion
    from bitneat.codegen import GeneratedC
    from bitneat.codegen.sensor import SensorFiles, SensorPlan

HELP = "write a champion as C that only adds and subtracts"
DESCRIPTION = """\
Writes C99 that needs no other file, no library, no heap and no floating point,
and neither multiplies nor divides. The same champion, options and version give
the same bytes. The header says how observations become the integers that the
step takes, and what its outputs mean."""
EXAMPLE = """\
  bitneat codegen champion.pkl -o walker.c
  bitneat codegen champion.pkl -o build/legs.c --name legs --style table --guard --selftest
  bitneat codegen champion.pkl -o libraries/walker --package arduino --sensor map.toml"""
FILES = """\
  CHAMPION         read: champion.pkl or champion.json
  FILE.c, FILE.h   written; with --selftest and --sensor more beside them
  DIR/             with --package: written, or renewed if it is such a package;
                   folders above them that are missing are made"""

KINDS = ("plain", "cmake", "arduino", "platformio", "zephyr")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``codegen``."""
    parser.add_argument("champion", type=Path, help="champion.pkl or champion.json")
    code = parser.add_argument_group("the C")
    code.add_argument("--name", help="prefix of every C name (default: the name of FILE or DIR)")
    code.add_argument(
        "--style",
        choices=("auto", "unrolled", "table"),
        default="auto",
        help="straight-line code, a table with an interpreter, or the smaller as compiled (default: auto)",
    )
    code.add_argument(
        "--guard", action="store_true", help="clamp observations to their limits, so that any int16 is allowed"
    )
    besides = parser.add_argument_group("what is written besides")
    besides.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="FILE.c|DIR",
        help="the source, the header goes beside it; with --package, a new folder or one to renew",
    )
    besides.add_argument("--selftest", action="store_true", help="also write NAME_selftest.c with known answers")
    besides.add_argument(
        "--sensor",
        type=Path,
        metavar="MAP.toml",
        help="also write NAME_sensors.c and .h, from sensor counts and to actuator counts (docs/sensor-maps.md)",
    )
    besides.add_argument(
        "--package", choices=KINDS, help="write a library that builds as it is in that ecosystem (docs/packages.md)"
    )
    add_json(besides)


def also_writes(args: argparse.Namespace) -> list[Path]:
    """What is written beside ``FILE.c``; a package is a folder of its own, whose files `run` knows."""
    output: Path = args.output
    if args.package or output.suffix != ".c":
        return []
    kinds = ["", "_sensors"] if args.sensor else [""]
    headers = [output.with_name(f"{output.stem}{kind}.h") for kind in kinds]
    sources = [output.with_name(f"{output.stem}{kind}.c") for kind in kinds[1:]]
    tests = [output.with_name(f"{output.stem}{kind}_selftest.c") for kind in kinds] if args.selftest else []
    return [*headers, *sources, *tests]


def run(args: argparse.Namespace) -> int:
    """Generate and write the files."""
    from bitneat import champion as champions
    from bitneat.codegen import generate
    from bitneat.files import write_json

    name, stem = _names(args)
    champion = champions.load(args.champion)
    sensors = _sensor_plan(args.sensor, champion)
    code = generate(
        champion.controller,
        name,
        args.style,
        guard=args.guard,
        action=champion.action,
        environment_id=champion.environment.id if champion.environment else "",
        header_name=f"{stem}.h",
    )
    sensor_code = None
    if sensors is not None:
        from bitneat.codegen.sensor import sensor_files

        sensor_code = sensor_files(code, champion.controller, sensors)
    write = _write_package if args.package else _write_files
    paths = write(args, champion, code, sensor_code)
    written = f"{args.output}: {args.package} package" if args.package else ", ".join(map(str, paths))
    encoding = f", encoding {code.encoding}" if code.encoding else ""
    print(
        f"{written}: style {code.style}{encoding}, {code.table_bytes} table bytes, controller {champion.controller.sha256[:12]}"
    )
    report = {} if sensors is None else _sensor_report(sensors)
    if args.json:
        write_json(
            args.json,
            {
                "sha256": champion.controller.sha256,
                "name": name,
                "style": code.style,
                "encoding": code.encoding,
                "table_bytes": code.table_bytes,
                "package": args.package,
                "sensors": report or None,
                "files": [str(path) for path in paths],
            },
        )
    return 0


def _names(args: argparse.Namespace) -> tuple[str, str]:
    """The prefix of C names and the stem of file names."""
    from bitneat.codegen.names import check_file_stem, check_name
    from bitneat.files import require_writable

    output: Path = args.output
    if args.package:
        if args.selftest:
            raise BitneatError("--selftest: every package has its self-test; leave it out with --package")
        name = args.name or output.absolute().name
        source = "--name" if args.name else f"{output} (choose another with --name)"
        return check_file_stem(check_name(name, source), source), name
    if output.is_dir():
        raise BitneatError(f"{output}: is a folder, expected a file name that ends in .c")
    if output.suffix != ".c":
        raise BitneatError(f"{output}: expected a file name that ends in .c")
    check_file_stem(output.stem, "-o")
    require_writable(_first_missing(output))
    if args.name is None:
        return check_name(output.stem, f"{output} (choose another with --name)"), output.stem
    return check_name(args.name, "--name"), output.stem


def _first_missing(path: Path) -> Path:
    """What has to be made first for a file to be written: it, or the highest of its folders that is missing."""
    while path != path.parent and not os.path.lexists(path.parent):
        path = path.parent
    return path


def _sensor_plan(path: Path | None, champion: Champion) -> SensorPlan | None:
    if path is None:
        return None
    from bitneat.codegen.sensor import plan, read_sensor_map
    from bitneat.controller import DiscreteAction

    num_outputs = 0 if isinstance(champion.action, DiscreteAction) else len(champion.controller.outputs)
    sensor_map = read_sensor_map(path, len(champion.controller.inputs), num_outputs)
    return plan(champion.controller, champion.action, sensor_map)


def _sensor_report(sensors: SensorPlan) -> dict[str, list[dict[str, Any]]]:
    """Print how near each map is, and give it as data."""
    from bitneat.codegen.sensor.emit import bound, formula

    report: dict[str, list[dict[str, Any]]] = {}
    for key, unit, channels in (("inputs", "signals", sensors.inputs), ("outputs", "counts", sensors.outputs)):
        report[key] = []
        for channel in channels:
            error = bound(channel.integer.error)
            print(f"  {key[:-1]} {channel.index} {channel.name}: within {error} {unit}; {formula(channel.integer)}")
            report[key].append(
                {
                    "index": channel.index,
                    "name": channel.name,
                    "error_bound": float(error),
                    "terms": len(channel.integer.terms),
                    "formula": formula(channel.integer),
                }
            )
    return report


def _write_files(
    args: argparse.Namespace, champion: Champion, code: GeneratedC, sensor_code: SensorFiles | None
) -> list[Path]:
    from bitneat.codegen import selftest
    from bitneat.files import make_folder, write_atomic

    output: Path = args.output
    files = {output.with_suffix(".h"): code.header, output: code.source}
    if args.selftest:
        files[output.with_name(f"{output.stem}_selftest.c")] = selftest(code, champion.controller)
    if sensor_code is not None:
        files[output.with_name(f"{output.stem}_sensors.h")] = sensor_code.header
        files[output.with_name(f"{output.stem}_sensors.c")] = sensor_code.source
        if args.selftest:
            files[output.with_name(f"{output.stem}_sensors_selftest.c")] = sensor_code.selftest
    make_folder(output.parent)
    for path, text in files.items():
        write_atomic(path, text.encode("ascii"))
    return list(files)


def _write_package(
    args: argparse.Namespace, champion: Champion, code: GeneratedC, sensor_code: SensorFiles | None
) -> list[Path]:
    from bitneat.codegen import selftest
    from bitneat.codegen.package import Package, flash_bytes, package_files, write_package

    package = Package(
        kind=args.package,
        code=code,
        selftest=selftest(code, champion.controller),
        controller=champion.controller,
        action=champion.action,
        environment_id=champion.environment.id if champion.environment else "",
        guard=args.guard,
        flash=flash_bytes(code),
        sensors=sensor_code,
    )
    files = package_files(package)
    paths = {args.output / path: text for path, text in files.items()}
    if args.json in paths:
        raise BitneatError(f"--json {args.json}: is another file of this command")
    write_package(args.output, args.package, code.name, files)
    return list(paths)
