# SPDX-License-Identifier: MIT
import json
import random
from pathlib import Path

import pytest

from bitneat.champion import save_pickle
from bitneat.cli.main import main
from bitneat.controller.packing import ENCODINGS, pack
from bitneat.verify.size import packed_bits
from tests.strategies import random_controller
from tests.verify.champions import champion, plain_champion


def test_both_styles_on_every_target_are_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    whose = champion("BipedalWalker-v3", seed=2, recurrent=True)
    save_pickle(whose, "champion.pkl")
    targets = ["--targets", "host-unrolled,host-table,cortex-m0"]
    assert main(["size", *targets, "--json", "size.json"]) == 0
    out = capsys.readouterr().out
    data = json.loads(Path("size.json").read_text())

    canonical = whose.controller.canonical
    assert data["controller"]["sha256"] == whose.controller.sha256
    assert data["controller"]["links"] == canonical.num_links
    assert data["controller"]["packed_bytes"] == len(pack(canonical)) == data["packed"][0]["bytes"]
    assert data["controller"]["paper_bytes"] == -(-canonical.num_links * 3 // 16)
    assert [(entry["name"], entry["style"]) for entry in data["targets"]] == [
        ("host-unrolled", "unrolled"),
        ("host-table", "table"),
        ("cortex-m0", "unrolled"),
        ("cortex-m0", "table"),
    ]
    for entry in data["targets"]:
        assert entry["flash_bytes"] > entry["table_bytes"] > 0
        assert entry["steps_compared"] is None
    flash = {entry["style"]: entry["flash_bytes"] for entry in data["targets"][2:]}
    assert data["smallest"]["cortex-m0"] == min(flash, key=flash.__getitem__)
    assert set(data["smallest"]) == {"host", "cortex-m0"}
    for text in ("cortex-m0", "the topology left out", "rice", "smallest", f"{canonical.num_links} links"):
        assert text in out


@pytest.mark.parametrize("seed", range(20))
def test_the_parts_of_the_packed_form_add_up(seed: int) -> None:
    controller = random_controller(random.Random(seed))
    shifts = any(link.shift for node in controller.canonical.nodes for link in node.links)
    sizes = packed_bits(controller)
    assert {bits.encoding for bits in sizes} == ({"bytes", "rice"} if shifts else set(ENCODINGS))
    assert [bits.num_bytes for bits in sizes] == sorted(bits.num_bytes for bits in sizes)
    assert sizes[0].num_bytes == len(pack(controller))
    for bits in sizes:
        assert bits.header + bits.topology + bits.weights + bits.fields == 8 * bits.num_bytes
        assert min(bits.header, bits.topology, bits.weights, bits.fields) >= 0


def test_a_controller_that_reaches_no_output_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from dataclasses import replace

    from bitneat.controller import Constant

    whose = plain_champion()
    save_pickle(replace(whose, controller=replace(whose.controller, outputs=(Constant(0),))), tmp_path / "c.pkl")
    assert main(["size", str(tmp_path / "c.pkl")]) == 2
    assert "no path from any input to an output" in capsys.readouterr().err
