# SPDX-License-Identifier: MIT
"""The map file: what it may say, and what is said to a bad one."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest

from bitneat.champion import Champion, save_pickle
from bitneat.cli.main import main
from bitneat.codegen.sensor import SensorMapError, plan, read_sensor_map
from bitneat.codegen.sensor.read import ConstantInput, MappedInput, MappedOutput, UnusedInput
from bitneat.controller import BoxAction, Controller, DiscreteAction, Input, Link, Node, Signal
from bitneat.controller.interval import Interval

CONTROLLER = Controller((Input(), Input(0, 500), Input()), (Node((Link(0), Link(1, sign=-1))),), (Signal(3),))
ACTION = BoxAction((-1.0,), (1.0,), (1,), "float32")
GOOD = """
unused_inputs = [2]
[[inputs]]
input = 1
name = "speed"
counts = [-100, 100]
scale = 0.01
offset = -0.5
[[inputs]]
input = 0
counts = [0, 1023]
points = [[0, -2], [1023, 2.0]]
tolerance = 0.75
[[outputs]]
output = 0
values = [-1, 1]
counts = [2000, 1000]
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "map.toml"
    path.write_text(text)
    return path


def test_a_map_is_read_in_the_order_of_the_inputs(tmp_path: Path) -> None:
    found = read_sensor_map(written(tmp_path, GOOD), 3, 1)
    assert found.inputs == (
        MappedInput("input_0", Interval(0, 1023), Fraction(4, 1023), Fraction(-2), Fraction(3, 4)),
        MappedInput("speed", Interval(-100, 100), Fraction(1, 100), Fraction(-1, 2), Fraction(1)),
        UnusedInput(),
    )
    assert found.outputs == (MappedOutput("output_0", (Fraction(-1), Fraction(1)), (2000, 1000), Fraction(1)),)


def test_a_constant_is_encoded_as_the_encoder_does_it(tmp_path: Path) -> None:
    entry = "unused_inputs = [2]\n[[inputs]]\ninput = 0\nconstant = {}\n[[inputs]]\ninput = 1\nconstant = 9.5\n"
    outputs = "[[outputs]]\noutput = 0\nvalues = [-1, 1]\ncounts = [0, 255]\n"
    for value, signal in (("0.001953125", 0), ("0.005859375", 2), ("-0.25", -64), ("1e6", 32767)):
        found = read_sensor_map(written(tmp_path, entry.format(value) + outputs), 3, 1)
        assert found.inputs[0] == ConstantInput(Fraction(value))
        assert dict(plan(CONTROLLER, ACTION, found).constants) == {0: signal, 1: 500, 2: 0}


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("inputs = ", "not TOML"),
        (GOOD.replace("\n", "\r\r"), "not TOML"),
        ("x = " + "[" * 5000, "not TOML"),
        ("inputs = 3", "inputs: expected tables, each under [[inputs]]"),
        ("", "the file: inputs is missing"),
        (GOOD + "[extra]\n", "the file: unknown key extra"),
        (changed("offset = -0.5", "ofset = -0.5"), "inputs[0]: unknown key ofset; expected counts, input, name"),
        (changed("offset = -0.5", f"{'z' * 41} = 1"), f"inputs[0]: unknown key '{'z' * 40}'; expected counts"),
        (changed("offset = -0.5", f"{'z' * 40} = 1"), f"inputs[0]: unknown key {'z' * 40}; expected counts"),
        (changed("offset = -0.5", '"a\\tb" = 1'), r"inputs[0]: unknown key 'a\tb'; expected counts"),
        (changed("offset = -0.5", ""), "inputs[0]: offset is missing"),
        (changed("counts = [0, 1023]", ""), "inputs[1]: counts is missing"),
        (changed("input = 1\n", ""), "inputs[0]: input is missing"),
        (changed("input = 1\n", "input = 3\n"), "inputs[0].input: expected a whole number in 0..2"),
        (changed("input = 1\n", "input = true\n"), "inputs[0].input: expected a whole number in 0..2"),
        (changed("input = 1\n", "input = 2\n"), "inputs[0].input: 2 was given before"),
        (changed("unused_inputs = [2]", ""), "inputs: nothing maps input 2"),
        (changed("unused_inputs = [2]", "unused_inputs = 2"), "unused_inputs: expected a list"),
        (changed("[-100, 100]", "[100, -100]"), "inputs[0].counts: expected [lowest, highest], got [100, -100]"),
        (changed("[-100, 100]", "[5, 5]"), "inputs[0].counts: expected [lowest, highest], got [5, 5]"),
        (changed("[-100, 100]", "[0.5, 100]"), "inputs[0].counts: expected two whole numbers"),
        (
            changed("[-100, 100]", "[0, 16777217]"),
            "inputs[0].counts: expected two whole numbers in -16777216..16777216",
        ),
        (changed("scale = 0.01", "scale = 0.0"), "inputs[0].scale: expected a number other than 0"),
        (changed("scale = 0.01", "scale = nan"), "inputs[0].scale: expected a finite number"),
        (changed("scale = 0.01", "scale = -inf"), "inputs[0].scale: expected a finite number"),
        (changed("scale = 0.01", "scale = 1e999999999"), "inputs[0].scale: expected a finite number"),
        (changed("scale = 0.01", "scale = 1e-999999999"), "inputs[0].scale: expected a finite number"),
        (changed("scale = 0.01", "scale = 1" + "0" * 4000), "inputs[0].scale: expected a finite number"),
        (changed("scale = 0.01", "scale = 1" + "0" * 9000), "map.toml: "),
        (changed("scale = 0.01", 'scale = "1"'), "inputs[0].scale: expected a finite number"),
        (changed("[[0, -2], [1023, 2.0]]", "[[5, -2], [5, 2]]"), "inputs[1].points: expected two points"),
        (changed("[[0, -2], [1023, 2.0]]", "[[5, -2], [6, -2]]"), "inputs[1].points: expected two points"),
        (changed("[[0, -2], [1023, 2.0]]", "[[5, -2]]"), "inputs[1].points: expected two points"),
        (changed("[[0, -2], [1023, 2.0]]", "[[5, -2], [6]]"), "inputs[1].points: expected two points"),
        (changed("[[0, -2], [1023, 2.0]]", "[1, 2]"), "inputs[1].points[0]: expected a list"),
        (changed("tolerance = 0.75", "tolerance = 0.5"), "inputs[1].tolerance: expected more than 0.5"),
        (changed('"speed"', '"2nd"'), "inputs[0].name: '2nd' is no C identifier"),
        (changed('"speed"', '"x; int y"'), "is no C identifier"),
        (changed('"speed"', '"while"'), "reserved word"),
        (changed('"speed"', '"typeof"'), "reserved word"),
        (changed('"speed"', '"i386"'), "'i386' is a macro that some compilers define"),
        (changed('"speed"', '"INT16_MAX"'), "may be a macro"),
        (changed('"speed"', '"input_0"'), "inputs: two are named input_0"),
        (changed('"speed"', "7"), "inputs[0].name: expected a string"),
        (changed("values = [-1, 1]", "values = [1, -1]"), "outputs[0].values: expected two numbers, the lower first"),
        (changed("values = [-1, 1]", "values = [1]"), "outputs[0].values: expected two numbers"),
        (changed("counts = [2000, 1000]", "counts = [5, 5]"), "outputs[0].counts: expected two different counts"),
        (changed("output = 0", "output = 1"), "outputs[0].output: expected a whole number in 0..0"),
        (GOOD[: GOOD.index("[[outputs]]")], "outputs: nothing maps output 0"),
    ],
)
def test_a_bad_map_is_one_line_with_file_key_and_what_was_expected(tmp_path: Path, text: str, why: str) -> None:
    with pytest.raises(SensorMapError) as refusal:
        read_sensor_map(written(tmp_path, text), 3, 1)
    assert why in str(refusal.value)
    assert str(refusal.value).startswith(str(tmp_path / "map.toml"))
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < len(str(tmp_path)) + 200


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (changed("unused_inputs = [2]", "unused_inputs = [0]").replace("input = 0", "input = 2"), "reads input 0"),
        (changed("offset = -0.5", "offset = 50"), "input 1 (speed): impossible range"),
        (changed("scale = 0.01", "scale = 1e7"), "input 1 (speed): too steep"),
        (
            changed("2], [1023, 2.0]]\ntolerance = 0.75", "3], [1023, 3.1]]\ntolerance = 0.500001"),
            "input 0 (input_0): no integer map is within",
        ),
        (changed("values = [-1, 1]", "values = [2, 3]"), "output 0 (output_0): impossible range"),
    ],
)
def test_a_map_that_cannot_be_made_says_which_and_why(tmp_path: Path, text: str, why: str) -> None:
    found = read_sensor_map(written(tmp_path, text), 3, 1)
    with pytest.raises(SensorMapError) as refusal:
        plan(CONTROLLER, ACTION, found)
    assert why in str(refusal.value)
    assert "map.toml" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_long_line_is_refused_before_it_is_parsed(tmp_path: Path) -> None:
    path = written(tmp_path, "x = [" + "1, " * 100_000 + "]")
    with pytest.raises(SensorMapError, match=r"map\.toml: a line has more than \d+ characters$"):
        read_sensor_map(path, 3, 1)


@pytest.mark.parametrize(("digits", "fits"), [(33, True), (60, True), (61, False)])
def test_a_number_has_at_most_sixty_digits(tmp_path: Path, digits: int, fits: bool) -> None:
    number = "0." + "7" * digits
    path = written(tmp_path, changed("scale = 0.01", f"scale = {number}"))
    if fits:
        found = read_sensor_map(path, 3, 1).inputs[1]
        assert isinstance(found, MappedInput)
        assert found.scale == Fraction(number)
    else:
        with pytest.raises(SensorMapError, match="expected a finite number"):
            read_sensor_map(path, 3, 1)


def test_without_an_action_space_outputs_go_from_minus_one_to_one(tmp_path: Path) -> None:
    found = read_sensor_map(written(tmp_path, GOOD), 3, 1)
    assert plan(CONTROLLER, None, found) == plan(CONTROLLER, BoxAction((-1.0,), (1.0,), (1,), "float32"), found)


def test_an_action_that_is_always_the_same_cannot_be_mapped(tmp_path: Path) -> None:
    found = read_sensor_map(written(tmp_path, GOOD), 3, 1)
    one_place = BoxAction((0.5,), (0.5,), (1,), "float32")
    with pytest.raises(
        SensorMapError, match=r"output 0 \(output_0\): the action is always 0\.5, there is nothing to map"
    ):
        plan(CONTROLLER, one_place, found)


def test_a_constant_may_have_a_name(tmp_path: Path) -> None:
    text = (
        'unused_inputs = [2]\n[[inputs]]\ninput = 0\nconstant = 1\nname = "{}"\n[[inputs]]\ninput = 1\nconstant = 0\n'
    )
    outputs = "[[outputs]]\noutput = 0\nvalues = [-1, 1]\ncounts = [0, 255]\n"
    assert read_sensor_map(written(tmp_path, text.format("gravity") + outputs), 3, 1).inputs[0] == ConstantInput(
        Fraction(1)
    )
    with pytest.raises(SensorMapError, match=r"inputs\[0\]\.name: '9.8' is no C identifier"):
        read_sensor_map(written(tmp_path, text.format("9.8") + outputs), 3, 1)


def test_a_choice_among_actions_has_no_outputs_to_map(tmp_path: Path) -> None:
    with pytest.raises(SensorMapError, match="outputs: the controller chooses among actions"):
        read_sensor_map(written(tmp_path, GOOD), 3, 0)


def test_the_command_prints_each_bound_and_writes_nothing_for_a_bad_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    save_pickle(Champion(CONTROLLER, ACTION), tmp_path / "champion.pkl")
    written(tmp_path, GOOD.replace("offset", "ofset"))
    command = ["codegen", "champion.pkl", "-o", "w.c", "--sensor", "map.toml", "--selftest"]
    assert main(command) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "w.c").exists()
    written(tmp_path, GOOD)
    assert main(command) == 0
    assert "input 1 speed: within 0." in capsys.readouterr().out
    files = {path.name for path in tmp_path.glob("w*")}
    assert files == {"w.c", "w.h", "w_selftest.c", "w_sensors.c", "w_sensors.h", "w_sensors_selftest.c"}
    assert main([*command[:-3], "--sensor", "nothing.toml"]) == 2
    assert "nothing.toml" in capsys.readouterr().err


def test_a_discrete_champion_takes_a_map_without_outputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    controller = Controller((Input(),), (Node((Link(0),)),), (Signal(0), Signal(1)))
    save_pickle(Champion(controller, DiscreteAction(2)), tmp_path / "champion.pkl")
    written(tmp_path, "[[inputs]]\ninput = 0\ncounts = [0, 255]\nscale = 0.1\noffset = 0\n")
    assert main(["codegen", "champion.pkl", "-o", "w.c", "--sensor", "map.toml"]) == 0
    assert "int32_t w_step_counts(const struct w_sensors *sensors);" in (tmp_path / "w_sensors.h").read_text()
