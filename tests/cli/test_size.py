# SPDX-License-Identifier: MIT
import json
import os
import random
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bitneat.champion import save_pickle
from bitneat.cli.main import main
from bitneat.controller.packing import ENCODINGS, pack
from bitneat.verify.check import Settings, verify
from bitneat.verify.implementation import ImplementationError
from bitneat.verify.size import SizeReport, packed_bits
from bitneat.verify.targets import TARGETS, select
from bitneat.verify.targets.chip import Chip
from bitneat.verify.targets.emulated import EmulatedC
from bitneat.verify.targets.unicorn_emulator import UnicornEmulator
from tests.strategies import random_controller
from tests.verify.champions import champion, plain_champion, written


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
    assert data["fastest"] == {"cortex-m0": "unrolled"}  # there is no emulator of the host
    for text in ("cortex-m0", "the topology left out", "rice", "smallest", "fastest", f"{canonical.num_links} links"):
        assert text in out


def measured(path: Path, *arguments: str) -> dict[tuple[str, str], dict[str, object]]:
    assert main(["size", str(path), *arguments, "--json", str(path.with_name("size.json"))]) == 0
    data = json.loads(path.with_name("size.json").read_text())
    return {(entry["name"], entry["style"]): entry for entry in data["targets"]}


def test_the_counts_are_those_that_verify_finds(tmp_path: Path) -> None:
    whose = champion(seed=3)
    save_pickle(whose, tmp_path / "c.pkl")
    names = ["cortex-m0", "rv32imc"]
    found = measured(tmp_path / "c.pkl", "--targets", ",".join(names))
    report = verify(whose, written(whose, tmp_path), select(names), Settings(1, max_steps=2, vectors=20))
    assert len(report.targets) == 4
    for entry in report.targets:
        assert entry.timing is not None
        size = found[entry.name, entry.style]
        assert size["instructions_per_step"] == entry.timing.instructions_per_step
        assert size["cycles_per_step"] == entry.timing.cycles
    assert [found[name, "table"]["cycles_per_step"] is None for name in names] == [False, True]


def test_without_an_emulator_no_style_is_called_the_fastest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(UnicornEmulator, "missing", lambda emulator: "the emulator unicorn")
    save_pickle(plain_champion(), tmp_path / "c.pkl")
    found = measured(tmp_path / "c.pkl", "--targets", "cortex-m0")
    assert {entry["instructions_per_step"] for entry in found.values()} == {None}
    assert json.loads((tmp_path / "size.json").read_text())["fastest"] == {}
    assert "fastest" not in capsys.readouterr().out


def test_a_style_that_does_not_fit_or_crashes_is_not_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    save_pickle(plain_champion(), tmp_path / "c.pkl")
    monkeypatch.setitem(TARGETS, "cortex-m0", replace(TARGETS["cortex-m0"], flash=5))  # type: ignore[type-var]
    found = measured(tmp_path / "c.pkl", "--targets", "cortex-m0")
    assert {entry["instructions_per_step"] for entry in found.values()} == {None}
    monkeypatch.undo()

    def crash(*arguments: object) -> None:
        raise ImplementationError("crashed (UC_ERR)")

    monkeypatch.setattr(EmulatedC, "trace", crash)
    assert main(["size", str(tmp_path / "c.pkl"), "--targets", "cortex-m0"]) != 0
    said = capsys.readouterr().err
    assert "cortex-m0 unrolled (controller_step): crashed (UC_ERR)" in said
    assert len(said.strip().splitlines()) == 1


def test_of_equally_small_styles_the_first_is_named() -> None:
    def entry(style: str, flash: int) -> Any:
        report = SimpleNamespace(name="cortex-m0", style=style, examination=SimpleNamespace(flash=flash))
        return SimpleNamespace(report=report)

    def smallest(*entries: Any) -> dict[str, str]:
        return SizeReport(plain_champion().controller, (), entries).smallest  # type: ignore[return-value]

    assert smallest(entry("unrolled", 100), entry("table", 100)) == {"cortex-m0": "unrolled"}
    assert smallest(entry("unrolled", 100), entry("table", 99)) == {"cortex-m0": "table"}


def test_nothing_is_run_unless_targets_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise AssertionError("runs code")

    monkeypatch.setattr(Chip, "implementation", refuse)
    save_pickle(plain_champion(), tmp_path / "c.pkl")
    assert all(entry["instructions_per_step"] is None for entry in measured(tmp_path / "c.pkl").values())


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


def test_a_champion_may_come_through_a_pipe(capfd: pytest.CaptureFixture[str]) -> None:
    content = (Path(__file__).parents[2] / "examples" / "champions" / "tiny.json").read_bytes()
    reading, writing = os.pipe()
    os.write(writing, content)
    os.close(writing)
    try:
        assert main(["size", f"/dev/fd/{reading}"]) == 0
    finally:
        os.close(reading)
    assert capfd.readouterr().out.startswith("controller ")
