# SPDX-License-Identifier: MIT
"""The files of a package, by path in its folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

from bitneat.codegen.package.view import Package, PackageError
from bitneat.codegen.templating import environment

MANIFEST = "bitneat-package.json"
"""The file that says that a folder is a package, of which kind and name, and which of its files are ours."""


@dataclass(frozen=True, slots=True)
class Layout:
    """What a kind of package adds to sources, README, licence and manifest: templates by path, ``NAME`` being its name."""

    templates: Mapping[str, str]
    reserved: frozenset[str] = frozenset()
    """Names that the ecosystem keeps for itself."""
    headers: frozenset[str] = frozenset()
    """Stems, in small letters, of headers that its programs include by a name without a folder."""


# CMake's own targets, and those that its generators add.
_CMAKE_TARGETS = frozenset(
    "all all_build clean depend edit_cache help install list_install_components package package_source preinstall"
    " rebuild_cache run_tests test uninstall zero_check".split()
)

# Of Arduino's cores and of the libraries that come with them.
_ARDUINO_HEADERS = frozenset(
    "arduino binary client eeprom ethernet hardwareserial hid ipaddress keyboard liquidcrystal mouse new pins_arduino"
    " pluggableusb print printable sd server servo softwareserial spi stepper stream udp usbapi wcharacter wifi wire"
    " wiring_private wstring".split()
)

KINDS: Mapping[str, Layout] = {
    "plain": Layout({"Makefile": "plain/Makefile.j2"}),
    "cmake": Layout(
        {"CMakeLists.txt": "cmake/CMakeLists.txt.j2", "NAMEConfig.cmake": "cmake/Config.cmake.j2"}, _CMAKE_TARGETS
    ),
    "arduino": Layout(
        {"library.properties": "arduino/library.properties.j2", "examples/NAME/NAME.ino": "arduino/example.ino.j2"},
        headers=_ARDUINO_HEADERS,
    ),
    "platformio": Layout(
        {
            "library.json": "platformio/library.json.j2",
            "examples/NAME/platformio.ini": "platformio/platformio.ini.j2",
            "examples/NAME/src/main.c": "platformio/main.c.j2",
        },
        headers=_ARDUINO_HEADERS,
    ),
    "zephyr": Layout(
        {
            "zephyr/module.yml": "zephyr/module.yml.j2",
            "zephyr/Kconfig": "zephyr/Kconfig.j2",
            "zephyr/CMakeLists.txt": "zephyr/CMakeLists.txt.j2",
            "samples/NAME/CMakeLists.txt": "zephyr/sample.CMakeLists.txt.j2",
            "samples/NAME/prj.conf": "zephyr/prj.conf.j2",
            "samples/NAME/src/main.c": "zephyr/main.c.j2",
        }
    ),
}


def package_files(package: Package) -> dict[str, str]:
    """The text of every file, by its path in the package; the manifest is the last.

    Raises:
        PackageError: if the ecosystem keeps the package's name for itself.
    """
    layout = KINDS[package.kind]
    if package.name.lower() in layout.reserved:
        raise PackageError(f"--name: {package.name!r} is a target of its own in {package.kind}; choose another name")
    if package.name.lower() in layout.headers:
        raise PackageError(
            f"--name: {package.name}.h is a header of Arduino, which it would hide in {package.kind}; choose another name"
        )
    files = {
        f"src/{package.code.header_name}": package.code.header,
        f"src/{package.name}.c": package.code.source,
        f"src/{package.name}_selftest.c": package.selftest,
    }
    if package.sensors is not None:
        files[f"src/{package.name}_sensors.h"] = package.sensors.header
        files[f"src/{package.name}_sensors.c"] = package.sensors.source
        files[f"src/{package.name}_sensors_selftest.c"] = package.sensors.selftest
    rows = {
        "README.md": "README.md.j2",
        "LICENSE": "LICENSE.j2",
        "src/NAME_selftest.h": "selftest.h.j2",
        **layout.templates,
    }
    for path, template in rows.items():
        text = environment().get_template(f"package/{template}").render(p=package)
        files[path.replace("NAME", package.name)] = text
    files[MANIFEST] = _manifest(package, sorted([*files, MANIFEST]))
    return files


def _manifest(package: Package, paths: list[str]) -> str:
    data = {
        "format": "bitneat-package",
        "version": 1,
        "kind": package.kind,
        "name": package.name,
        "controller": package.sha256,
        "files": paths,
    }
    return json.dumps(data, indent=2) + "\n"
