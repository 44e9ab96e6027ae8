# SPDX-License-Identifier: MIT
"""The benchmarks measure what they say; how fast this machine is, no test asks."""

import json
from pathlib import Path

import numpy as np
import pytest

from bitneat.bench.measurement import Measurement, side_by_side
from bitneat.bench.network import hundred_links
from bitneat.bench.runtime import as_neat_network
from bitneat.cli.bench import table
from bitneat.cli.main import main
from bitneat.controller import Reference


def test_the_measured_network_has_100_live_ternary_links() -> None:
    controller = hundred_links()
    assert controller.num_links == 100
    assert controller.is_ternary
    assert controller == hundred_links()


def test_neat_pythons_network_computes_the_same_numbers() -> None:
    controller = hundred_links()
    network, reference = as_neat_network(controller), Reference(controller)
    draw = np.random.default_rng(1)
    for row in draw.integers(-2047, 2048, (50, len(controller.inputs))):
        expected = [value * controller.one for value in network.activate([int(x) / controller.one for x in row])]
        assert list(reference.step([int(x) for x in row])) == expected


def test_the_ratio_is_the_median_of_neighbours_without_the_first_turn() -> None:
    ours = iter([100.0, 1.0, 2.0, 4.0])
    baseline = iter([100.0, 3.0, 2.0, 16.0])
    pair = side_by_side(lambda: next(ours), lambda: next(baseline), 3)
    assert (pair.ours, pair.baseline, pair.ratio) == (2.0, 3.0, 3.0)


def test_the_table_is_markdown_and_says_whether_a_goal_is_met() -> None:
    lines = [
        Measurement("a", 1.5, "b", 3.0, "s", 2.0, "times as fast", ">= 1", True),
        Measurement("c", 1500.4, "d", 3.0, "s", 2.0, "times as fast", ">= 3", False),
        Measurement("e", 1.0, "f", 3.0, "s", 2.0, "times as fast", "", None),
    ]
    rows = table(lines).splitlines()
    assert len({len(row) for row in rows}) == 1
    assert [row.split("|")[-2].strip() for row in rows[2:]] == ["yes", "no", ""]
    assert "1500 s" in rows[3]


@pytest.mark.parametrize("subject", ["runtime", "codegen", "startup", pytest.param("evolve", marks=pytest.mark.long)])
def test_every_subject_gives_a_table_and_json(subject: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "bench.json"
    assert main(["bench", subject, "--repetitions", "1", "--json", str(out)]) == 0
    printed = capsys.readouterr().out
    measurements = json.loads(out.read_text())["measurements"]
    assert measurements
    for line in measurements:
        assert line["ours"] > 0
        assert line["baseline"] > 0
        assert f"| {line['what']} " in printed
