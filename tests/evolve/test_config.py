# SPDX-License-Identifier: MIT
"""Configurations: presets are complete, and nothing wrong slips past."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bitneat.champion import EnvironmentSpec
from bitneat.errors import BitneatError
from bitneat.evolve.config import PRESETS, SCHEMA, load, parse, preset_for, preset_names

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_is_valid_and_its_full_text_reads_back_equal(name: str) -> None:
    config = load(name)
    again = parse(config.text, "again")
    assert again.text == config.text
    assert set(config.sections) == set(SCHEMA)
    for section, entries in SCHEMA.items():
        assert set(config[section]) == set(entries)


def test_presets_are_chosen_by_environment() -> None:
    assert set(PRESETS.values()) <= set(preset_names())
    assert preset_for(EnvironmentSpec("BipedalWalker-v3")) == "bipedalwalker"
    assert preset_for(EnvironmentSpec("BipedalWalker-v3", {"hardcore": True})) == "hardcore"
    assert preset_for(EnvironmentSpec("Mystery-v0")) == "default"
    assert "default" in preset_names()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[evolve]\ngeneratoins = 3\n", r"my\.ini: \[evolve\] generatoins: unknown key \(did you mean generations\?\)"),
        ("[BitGenome]\nweight_max_value = 3\n", r"my\.ini: \[BitGenome\] weight_max_value: unknown key"),
        ("[BitGenome]\nconn_add_prob = 0.5\n", r"\[BitGenome\] conn_add_prob: unknown key"),
        ("[DefaultGenome]\nnum_inputs = 3\n", r"my\.ini: unknown section \[DefaultGenome\] \(known: evolve, NEAT"),
        ("[NEAT]\npop_size = many\n", r"\[NEAT\] pop_size = many: expected an integer from 2"),
        ("[NEAT]\npop_size = 1\n", r"\[NEAT\] pop_size = 1: expected an integer from 2"),
        ("[NEAT]\npop_size = 1e3\n", r"\[NEAT\] pop_size = 1e3: expected an integer"),
        (
            "[BitReproduction]\ncrossover = 1.5\n",
            r"\[BitReproduction\] crossover = 1\.5: expected a number from 0 to 1",
        ),
        ("[BitReproduction]\ncrossover = nan\n", r"crossover = nan: expected a number"),
        ("[BitGenome]\nweight_zero_rate = -0.1\n", r"weight_zero_rate = -0\.1: expected a number from 0 to 1"),
        ("[BitGenome]\nactivations = clamped softmax\n", r"activations = clamped softmax: expected some of identity"),
        ("[BitGenome]\nactivations =\n", r"activations = : expected some of"),
        ("[BitGenome]\noutput_activation = clamped hat\n", r"output_activation = clamped hat: expected one of"),
        ("[BitGenome]\ngain_min = 3\ngain_max = 2\n", r"\[BitGenome\] gain_min: expected at most gain_max"),
        ("[BitGenome]\ngain_max = 1\n", r"gain_init_min, gain_init_max: expected within"),
        ("[BitGenome]\ngain_max = 8\n", r"gain_max = 8: expected an integer from -7 to 7"),
        ("[evolve]\nfrac_bits = 13\n", r"frac_bits = 13: expected an integer from 4 to 12"),
        ("[evolve]\nrace_episodes = 4 2\nrace_fractions = 1 .5\n", r"race_episodes = 4 2: .*each larger"),
        ("[evolve]\nrace_episodes = 1 2\nrace_fractions = 1\n", r"race_fractions: expected as many"),
        ("[evolve]\nrace_episodes = 1 2\nrace_fractions = .5 .2\n", r"race_fractions: expected 1 first"),
        ("[evolve]\ninput_limits = 0\n", r"input_limits = 0: expected integers from 1 to 32767"),
        ("[evolve]\nfall_ramp_start = 5\n", r"fall_ramp_end: expected at least fall_ramp_start"),
        ("[evolve]\nfall_reward = inf\n", r"fall_reward = inf: expected a number"),
        ("generations = 3\n", r"my\.ini: File contains no section headers"),
        ("[evolve]\nseed 3\n", r"my\.ini: .*parsing errors"),
        ("[evolve]\nrisk = 0\nrisk = 1\n", r"my\.ini: .*already exists"),
        ("[evolve]\n[evolve]\n", r"my\.ini: .*already exists"),
        (
            "[BitGenome]\n" + "\n".join(f"{key} = 0" for key in SCHEMA["BitGenome"] if key.startswith("mutate_")),
            r"mutate_\*: expected at least one",
        ),
        (
            "[NEAT]\ngenome = WeightAgnostic\n[BitGenome]\n"
            + "\n".join(
                f"{key} = {key == 'mutate_gain':d}" for key in SCHEMA["BitGenome"] if key.startswith("mutate_")
            ),
            r"mutate_\*: expected at least one above 0 besides mutate_gain and mutate_bias",
        ),
        ("[BitReproduction]\nmin_species_size = 9\n[NEAT]\npop_size = 8\n", r"min_species_size: expected at most"),
    ],
)
def test_whatever_is_wrong_is_refused_by_file_section_and_key(text: str, message: str) -> None:
    with pytest.raises(BitneatError, match=message) as caught:
        parse(text, "my.ini")
    assert "\n" not in str(caught.value)


def test_a_source_that_is_neither_file_nor_preset_names_the_presets(tmp_path: Path) -> None:
    with pytest.raises(BitneatError, match=r"neither a file nor a preset \(presets: acrobot"):
        load(str(tmp_path / "none.ini"))
    (tmp_path / "binary.ini").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BitneatError, match=r"binary\.ini: not a text file"):
        load(str(tmp_path / "binary.ini"))


def test_values_from_the_command_line_are_checked_too() -> None:
    config = load("cartpole").with_values("NEAT", pop_size=33)
    assert config["NEAT"]["pop_size"] == 33
    with pytest.raises(BitneatError, match=r"command line: \[NEAT\] pop_size = 1"):
        load("cartpole").with_values("NEAT", pop_size=1)


def documented_keys() -> dict[str, set[str]]:
    """The keys in the tables of docs/evolve.md, by section."""
    keys: dict[str, set[str]] = {section: set() for section in SCHEMA}
    section = ""
    for line in (ROOT / "docs" / "evolve.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        named = re.fullmatch(r"(key of )?`\[(\w+)\]`", cells[0])
        if not line.startswith("|"):
            section = ""  # the table is over
        elif named:
            section = named[2]
        if section and not (named and named[1]):  # what is named there heads the column
            keys[section].update(re.findall(r"`(\w+)`", cells[-2]))
    return keys


@pytest.mark.parametrize("section", SCHEMA)
def test_every_key_stands_in_the_documentation_by_its_name(section: str) -> None:
    assert documented_keys()[section] == set(SCHEMA[section])


def test_a_configuration_may_begin_with_the_mark_of_utf_8(tmp_path: Path) -> None:
    path = tmp_path / "my.ini"
    path.write_bytes(b"\xef\xbb\xbf[evolve]\ngenerations = 3\n")
    assert load(str(path))["evolve"]["generations"] == 3
