# SPDX-License-Identifier: MIT
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bitneat.champion import Champion, EnvironmentSpec
from bitneat.codegen import STYLES
from bitneat.controller import Controller, Encoder, Input, Link, Node, Signal
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.native.compiler import CompilerError
from bitneat.sim.environment import make
from bitneat.verify import check as under_test
from bitneat.verify.cfile import CFile
from bitneat.verify.check import HARDCORE, Settings, paper_bytes, verify
from bitneat.verify.implementation import Implementation, ImplementationError
from bitneat.verify.machine import Toolchain
from bitneat.verify.targets import HostTarget, ReadyTarget, select
from bitneat.verify.targets.emulated import EmulatedC
from bitneat.version import __version__
from tests.verify.champions import champion, plain_champion, written

HOST = ("host-unrolled", "host-table")
SHORT = Settings(episodes=2, max_steps=30)


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize(
    ("environment_id", "recurrent"), [("Pendulum-v1", True), ("CartPole-v1", False), ("BipedalWalker-v3", True)]
)
def test_what_codegen_writes_passes_in_both_styles(
    style: str, environment_id: str, recurrent: bool, tmp_path: Path
) -> None:
    whose = champion(environment_id, seed=5, recurrent=recurrent)
    report = verify(whose, written(whose, tmp_path, style), select(HOST), SHORT)  # type: ignore[arg-type]
    assert report.failures == report.warnings == ()
    assert report.loop is not None
    assert [(t.name, t.loop_steps, t.steps_compared, t.mismatches) for t in report.targets] == [
        (name, report.loop.steps, report.loop.steps + 2000, 0) for name in HOST
    ]
    assert [t.examination.ram for t in report.targets] == [2 * n for n in states(whose, tmp_path)]


def states(whose: Champion, folder: Path) -> list[int]:
    return [written(whose, folder, style, stem=f"s_{style}").num_state or 0 for style in STYLES]


def test_the_first_difference_is_named_and_all_are_counted(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    code.path.write_text(
        code.source.replace("action[0] = legs_signal(n0);", "action[0] = (int16_t)(legs_signal(n0) ^ 1);")
    )
    report = verify(whose, CFile.read(code.path), select(["host-unrolled"]), Settings(seed=7, episodes=1, max_steps=30))
    assert not report.passed
    mismatch = report.mismatch
    assert mismatch is not None
    assert (mismatch.place.episode, mismatch.place.seed, mismatch.place.step, mismatch.output) == (0, 7, 0, 0)
    assert mismatch.got is not None
    assert mismatch.expected == mismatch.got ^ 1
    expected = f"host-unrolled (legs_step): episode 0 (seed 7), step 0: output 0 is {mismatch.got}, expected {mismatch.expected}"
    assert report.failures[0] == expected
    assert report.targets[0].loop_steps == 30
    assert report.targets[0].mismatches == 30 + 2000
    assert report.to_data()["mismatch"]["got"] == mismatch.got


def test_a_wrong_decision_is_a_failure(tmp_path: Path) -> None:
    whose = champion("CartPole-v1", seed=2)
    code = written(whose, tmp_path)
    code.path.write_text(code.source.replace("return (int32_t)index + (0);", "return 1 - (int32_t)index;"))
    report = verify(whose, CFile.read(code.path), select(["host-unrolled"]), SHORT)
    assert report.mismatch is not None
    assert report.mismatch.output == "decide"
    assert "the decision is" in report.failures[0]


def test_a_difference_that_the_loop_does_not_reach_is_found_on_vectors(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    text = "action[0] = (int16_t)(legs_signal(n0) + (observation[0] + observation[1] + observation[2] > 2500));"
    code.path.write_text(code.source.replace("action[0] = legs_signal(n0);", text))
    report = verify(whose, CFile.read(code.path), select(["host-unrolled"]), SHORT)
    assert report.mismatch is not None
    assert report.mismatch.place.episode is None
    assert sum(report.mismatch.inputs) > 2500


def test_a_crash_fails_and_the_others_go_on(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    code.path.write_text(code.source.replace("action[0] =", "*(volatile int *)0 = 1; action[0] ="))
    report = verify(whose, CFile.read(code.path), select(HOST), SHORT)
    assert "crashed" in report.failures[0]
    assert [(t.loop_steps, t.mismatches) for t in report.targets] == [(0, 1), (60, 0)]


def test_an_edit_without_effect_is_a_failure_too(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    code.path.write_text(code.source.replace("action[0] =", "/* mine */ action[0] ="))
    report = verify(whose, CFile.read(code.path), select(["host-unrolled"]), SHORT)
    line = code.source[: code.source.index("action[0] =")].count("\n") + 1
    assert report.failures == (f"{code.path}: edited: line {line} is not what codegen writes for this controller",)
    assert report.targets[0].loop_steps == 60


def test_a_compiler_that_refuses_what_nobody_edited_is_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object) -> None:
        raise CompilerError("cc: legs.c: failed: no space left")

    monkeypatch.setattr(under_test, "examine", refuse)
    whose = plain_champion()
    with pytest.raises(CompilerError, match="no space left"):
        verify(whose, written(whose, tmp_path), select(["host-unrolled"]), SHORT)


def test_an_edited_formula_in_the_header_is_a_failure(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    lines = code.header.splitlines(keepends=True)
    number = next(i for i, line in enumerate(lines) if "256" in line and "SHA" not in line and line.startswith(" *"))
    lines[number] = lines[number].replace("256", "255")
    code.header_path.write_text("".join(lines))
    report = verify(whose, CFile.read(code.path), select(["host-unrolled"]), SHORT)
    edited = f"{code.header_path}: edited: line {number + 1} is not what codegen writes for this controller"
    assert report.failures == (edited,)


def test_an_edited_file_that_does_not_compile_is_a_failure(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    code.path.write_text(code.source + "}\n")
    report = verify(whose, CFile.read(code.path), select(["host-unrolled"]), SHORT)
    assert "edited: line" in report.failures[0]
    assert "failed" in report.failures[1]


@pytest.mark.parametrize(
    ("extra", "violation"),
    [
        (
            '__attribute__((constructor)) static void early(void) { __asm__ volatile (""); }',
            "bytes of static data in .init_array",
        ),
        ('__asm__(".section .init,\\"ax\\",%progbits\\n nop\\n .text");', ".init runs by itself"),
        (
            "extern int getpid(void); int other(void); int other(void) { return getpid(); }",
            "needs getpid from elsewhere",
        ),
        ("int kept = 1;", "bytes of static data in .data"),
        ("#ifdef __PIC__\nint kept = 1;\n#endif", "bytes of static data in .data"),
        ("#if __STDC_HOSTED__\nint kept = 1;\n#endif", None),
    ],
)
def test_c_that_breaks_its_promises_is_never_run(
    extra: str, violation: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    code.path.write_text(f"{code.source}{extra}\n")
    ran = []
    whole = HostTarget.implementations

    def noted(target: HostTarget, one: CFile, toolchain: Toolchain) -> list[Implementation]:
        ran.append(one.style)
        return whole(target, one, toolchain)

    monkeypatch.setattr(HostTarget, "implementations", noted)
    report = verify(whose, CFile.read(code.path), select(HOST), Settings(episodes=1, max_steps=3))
    assert not report.passed
    assert ran == (["table"] if violation else ["unrolled", "table"])
    assert violation is None or any(violation in failure for failure in report.failures)


@pytest.mark.parametrize("names", [["cortex-m0"], ["host-table"], ["host-table", "cortex-m0"]])
def test_targets_of_which_none_runs_the_file_are_refused(names: list[str], tmp_path: Path) -> None:
    whose = plain_champion()
    message = r"no target of these runs .*legs.c \(style unrolled\); add host-unrolled"
    with pytest.raises(BitneatError, match=message):
        verify(whose, written(whose, tmp_path), select(names, run="host-table" in names and len(names) == 1), SHORT)


def test_c_of_another_version_is_judged_by_what_it_does(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    code.path.write_text(code.source.replace("generated by bitneat ", "generated by bitneat 9."))
    report = verify(whose, CFile.read(code.path), select(["host-unrolled"]), SHORT)
    assert report.passed
    assert "only its behaviour is judged" in report.warnings[0]


@pytest.mark.parametrize(("place", "flipped"), [(-1, 0), (-1, 1), (0, 0xFF)])
def test_the_blob_in_c_of_before_is_unpacked(place: int, flipped: int, tmp_path: Path) -> None:
    """bitneat 0.1 wrote the whole packed controller where there is a table without its header now."""
    whose = plain_champion()
    code = written(whose, tmp_path, "table")
    blob = bytearray(pack(whose.controller))
    blob[place] ^= flipped
    text = ", ".join(f"0x{byte:02x}" for byte in blob)
    array = f"static const uint8_t {code.name}_blob[{len(blob)}] LEGS_IN_FLASH = {{\n    {text}\n}};\n"
    source = code.source.replace(f"generated by bitneat {__version__}", "generated by bitneat 0.1.0")
    at = source.index("static const uint8_t")
    code.path.write_text(source[:at] + array.replace(" LEGS_IN_FLASH", "") + source[at:])
    old = CFile.read(code.path)
    assert old.blob == bytes(blob)
    report = verify(whose, old, select(["host-table"]), SHORT)
    assert [f for f in report.failures if "blob" in f] == (
        ["legs.c: its blob is not this controller, packed"] if flipped else []
    )


@pytest.mark.parametrize("suffix", [".c", ".h"])
def test_a_source_or_header_of_another_controller_is_stale(suffix: str, tmp_path: Path) -> None:
    whose, other = plain_champion(), plain_champion(-1)
    code = written(whose, tmp_path)
    path = code.path.with_suffix(suffix)
    path.write_text(path.read_text().replace(whose.controller.sha256, other.controller.sha256))
    report = verify(whose, CFile.read(code.path), select(HOST), SHORT)
    assert not report.passed
    assert report.failures[0].startswith(f"{path}: stale: generated for controller {other.controller.sha256[:12]}")
    assert report.to_data()["targets"] == []


def test_a_table_that_codegen_does_not_write_is_a_failure(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path, "table")
    assert code.table is not None
    first = f"0x{code.table[0][0]:02x}"
    changed = f"0x{code.table[0][0] ^ 0x40:02x}"
    at = code.source.index(first, code.table[1])
    code.path.write_text(code.source[:at] + changed + code.source[at + 4 :])
    report = verify(whose, CFile.read(code.path), select(["host-table"]), SHORT)
    assert not report.passed
    assert any("its table of links is not the one" in failure for failure in report.failures)


def test_a_header_of_another_shape_is_a_failure(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    code.header_path.write_text(code.header.replace("NUM_INPUTS 3", "NUM_INPUTS 4"))
    report = verify(whose, CFile.read(code.path), select(HOST), SHORT)
    says = "says 4 inputs, 1 outputs, 8 fractional bits; the controller has 3, 1, 8"
    assert report.failures == (f"{code.header_path}: edited: {says}",)
    assert report.loop is None


def test_the_inputs_report_says_what_the_sensors_delivered(tmp_path: Path) -> None:
    whole = plain_champion()
    limits = (Input(0, 100), Input(0, 32767), Input(1, 30))
    whose = Champion(
        Controller(limits, whole.controller.nodes, whole.controller.outputs, 8), whole.action, whole.environment
    )
    report = verify(whose, written(whose, tmp_path), select(["host-unrolled"]), SHORT)
    assert report.passed
    assert report.loop is not None

    # The same episodes once more, by hand.
    seen = []
    for seed in SHORT.seeds:
        environment = make(EnvironmentSpec("Pendulum-v1"))
        observation, _ = environment.reset(seed=seed)
        from bitneat.controller import Reference

        reference, encode = Reference(whose.controller), Encoder(whose.controller)
        for _ in range(30):
            seen.append(np.asarray(observation, dtype=np.float64))
            outputs = np.array(reference.step(encode(observation).tolist()), dtype=np.int16)
            observation, *_ = environment.step(whose.action.decode(outputs, 8))
        environment.close()
    values = np.array(seen)
    scaled = np.abs(np.rint(values * np.array([256.0, 256.0, 512.0])))
    assert [entry.min for entry in report.loop.inputs] == values.min(axis=0).tolist()
    assert [entry.max for entry in report.loop.inputs] == values.max(axis=0).tolist()
    clipped = (scaled > np.array([100, 32767, 30])).sum(axis=0).tolist()
    assert [entry.clipped for entry in report.loop.inputs] == clipped
    assert clipped[0] > 0
    assert clipped[1] == 0


def test_the_report_has_exactly_the_promised_keys(tmp_path: Path) -> None:
    whose = plain_champion()
    data = verify(whose, written(whose, tmp_path), select(HOST), SHORT).to_data()
    assert list(data) == [
        "command", "verdict", "controller", "c_file", "c_sha256", "environment", "episodes", "steps", "reward", "inputs",
        "saturated_outputs", "targets",
    ]  # fmt: skip
    assert list(data["controller"]) == ["sha256", "ternary", "nodes", "links", "packed_bytes", "paper_bytes"]
    assert list(data["reward"]) == ["mean", "std", "min", "max"]
    assert list(data["inputs"][0]) == ["min", "max", "clipped"]
    assert list(data["targets"][0]) == [
        "name", "compiler", "style", "steps_compared", "mismatches", "flash_bytes", "ram_bytes", "stack_bytes",
        "instructions_per_step", "cycles_per_step", "loop_steps", "trace",
    ]  # fmt: skip
    assert (data["verdict"], data["episodes"], data["steps"]) == ("pass", 2, 60)
    assert data["controller"]["paper_bytes"] == 1


@pytest.mark.parametrize("handed_out", [True, False])
def test_only_a_file_that_is_handed_out_is_named(handed_out: bool, tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    data = verify(whose, code, select(["host-unrolled"]), SHORT, handed_out=handed_out).to_data()
    assert data["c_file"] == (str(code.path) if handed_out else None)
    assert data["c_sha256"] == code.content_sha256


@pytest.mark.parametrize(("links", "expected"), [(0, 0), (1, 1), (5, 1), (6, 2), (16, 3), (17, 4)])
def test_the_papers_own_figure_is_a_bit_and_a_half_a_link(links: int, expected: int) -> None:
    inputs = tuple(Input() for _ in range(max(links, 1)))
    node = Node(tuple(Link(i) for i in range(links)))
    assert paper_bytes(Controller(inputs, (node,), (Signal(len(inputs)),), 8)) == expected


def unasked(name: str, **memory: int) -> ReadyTarget:
    (ready,) = select([name])
    return replace(ready, asked=False, target=replace(ready.target, **memory))  # type: ignore[type-var]


def test_a_chip_that_nobody_asked_for_and_is_too_small_is_a_warning(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    targets = [*select(["host-unrolled"]), unasked("rv32ec", flash=5), unasked("cortex-m0", ram=3)]
    report = verify(whose, code, targets, SHORT)
    assert report.passed
    assert len(report.warnings) == 4
    assert [warning.split(":")[0] for warning in report.warnings] == [
        "rv32ec (unrolled)",
        "rv32ec (table)",
        "cortex-m0 (unrolled)",
        "cortex-m0 (table)",
    ]
    assert all(": not run: needs " in warning for warning in report.warnings)
    assert {(target.name, target.steps_compared) for target in report.targets[1:]} == {
        ("rv32ec", None),
        ("cortex-m0", None),
    }


def test_a_violation_names_the_style_where_a_target_has_both(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    code.path.write_text(code.source.replace("    action[0]", "    extern void f(void); f();\n    action[0]", 1))
    report = verify(whose, CFile.read(code.path), select(["host-unrolled", "cortex-m0"]), SHORT)
    assert not report.passed
    said = {failure.split(":")[0] for failure in report.failures if "needs f from elsewhere" in failure}
    assert said == {"host-unrolled", "cortex-m0 (unrolled)"}


def test_the_same_seeds_give_the_same_report(tmp_path: Path) -> None:
    whose = champion("BipedalWalker-v3", seed=1)
    code = written(whose, tmp_path)
    first, again = (verify(whose, code, select(["host-unrolled"]), SHORT).to_data() for _ in range(2))
    assert first == again
    other = verify(whose, code, select(["host-unrolled"]), Settings(episodes=2, seed=1, max_steps=30))
    assert other.loop is not None
    assert [episode.seed for episode in other.loop.episodes] == [1, 2]


def test_hardcore_is_its_own_environment(tmp_path: Path) -> None:
    whose = champion("BipedalWalker-v3", seed=1)
    settings = Settings(episodes=1, max_steps=5, environment=HARDCORE)
    report = verify(whose, written(whose, tmp_path), select(["host-unrolled"]), settings)
    assert (report.passed, report.environment_id) == (True, "BipedalWalkerHardcore-v3")


@pytest.mark.parametrize(
    ("environment_id", "message"),
    [
        ("BipedalWalkerHardcore-v3", "has 24 observations, the controller 3"),
        ("MountainCarContinuous-v0", "has 2 observations, the controller 3"),
        ("NoSuchThing-v0", "environment NoSuchThing-v0"),
    ],
)
def test_an_environment_that_does_not_fit_is_bad_input(environment_id: str, message: str, tmp_path: Path) -> None:
    whose = plain_champion()
    settings = Settings(environment=EnvironmentSpec(environment_id))
    with pytest.raises(BitneatError, match=message):
        verify(whose, written(whose, tmp_path), select(["host-unrolled"]), settings)


def test_an_environment_of_other_actions_does_not_fit(tmp_path: Path) -> None:
    whose = champion("MountainCarContinuous-v0")
    settings = Settings(environment=EnvironmentSpec("MountainCar-v0"))
    with pytest.raises(BitneatError, match=r"^environment MountainCar-v0: its action space is not the champion's$"):
        verify(whose, written(whose, tmp_path), select(["host-unrolled"]), settings)


def test_what_cannot_be_traced_is_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(*arguments: object) -> None:
        raise ImplementationError("crashed (UC_ERR)")

    monkeypatch.setattr(EmulatedC, "trace", crash)
    whose = plain_champion()
    report = verify(whose, written(whose, tmp_path), select(["host-unrolled", "cortex-m0"]), SHORT)
    assert not report.passed
    said = "when it was traced, it crashed (UC_ERR)"
    assert report.failures[0] == f"cortex-m0 unrolled (legs_step): {said}"
    assert all(failure.endswith(said) for failure in report.failures)
    assert {target.timing for target in report.targets} == {None}


def test_a_champion_without_an_environment_has_no_loop(tmp_path: Path) -> None:
    whose = plain_champion()
    code = written(whose, tmp_path)
    with pytest.raises(BitneatError, match="names no environment"):
        verify(Champion(whose.controller, whose.action), code, select(["host-unrolled"]), SHORT)
