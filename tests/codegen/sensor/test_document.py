# SPDX-License-Identifier: MIT
"""What docs/sensor-maps.md shows holds."""

from __future__ import annotations

import re
from pathlib import Path

from bitneat.codegen.sensor import plan, read_sensor_map
from bitneat.codegen.sensor.emit import bound, formula
from bitneat.controller import BoxAction, Controller, Input, Link, Node, Signal

PAGE = (Path(__file__).parents[3] / "docs" / "sensor-maps.md").read_text(encoding="utf-8")


def test_the_file_that_is_shown_is_read_and_gives_the_map_that_is_shown(tmp_path: Path) -> None:
    example = re.search(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert example is not None
    path = tmp_path / "map.toml"
    path.write_text(example[1])
    links = (Link(0), Link(3), Link(4, sign=-1))
    controller = Controller((Input(0, 2047),) * 5, (Node(links),), (Signal(5),))
    sensors = plan(controller, BoxAction((-1.0,), (1.0,), (1,), "float32"), read_sensor_map(path, 5, 1))
    channel = sensors.inputs[0]
    line = f"    input 0 {channel.name}: within {bound(channel.integer.error)} signals; {formula(channel.integer)}\n"
    assert line in PAGE
    largest = max(abs(channel.integer(x) - channel.exact(x)) for x in range(4096))
    assert largest < channel.integer.error
    assert f" {bound(largest)}" in PAGE
