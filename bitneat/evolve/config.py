# SPDX-License-Identifier: MIT
"""The configuration of a run: ini files with a schema that nothing slips past.

neat-python accepts unknown keys of a genome and probabilities above one in silence. Here every key is in `SCHEMA` with its type,
range and default; whatever is not, is refused by file, section and key. `docs/evolve.md` explains each entry.
"""

from __future__ import annotations

import configparser
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any

from bitneat.champion import EnvironmentSpec
from bitneat.controller import ACTIVATION_NAMES
from bitneat.controller.digits import LARGEST_SHIFTED_WEIGHT
from bitneat.controller.ir import FRAC_BITS_RANGE, GAIN_RANGE, SCALE_RANGE, SIGNAL_MAX
from bitneat.errors import BitneatError
from bitneat.files import read_capped

MAX_CONFIG_BYTES = 1 << 20

PAPER_ACTIVATIONS = ("clamped", "identity", "sin", "gauss", "tanh", "sigmoid", "abs", "relu")
"""The eight of the Bit-Pedal Walker paper; its "linear" is the identity."""


class ConfigError(BitneatError):
    """A configuration is wrong; the message names file, section, key and what was expected."""


@dataclass(frozen=True)
class Whole:
    """An integer from low to high."""

    default: int
    low: int
    high: int

    def parse(self, text: str) -> int:
        """The value, or ValueError with what was expected."""
        try:
            value = int(text)
        except ValueError:
            raise ValueError(f"expected an integer from {self.low} to {self.high}") from None
        if not self.low <= value <= self.high:
            raise ValueError(f"expected an integer from {self.low} to {self.high}")
        return value


@dataclass(frozen=True)
class Real:
    """A finite number from low to high; 'none' stands for NaN where that is the default."""

    default: float
    low: float
    high: float

    def parse(self, text: str) -> float:
        """The value, or ValueError with what was expected."""
        if math.isnan(self.default) and text.lower() == "none":
            return math.nan
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not self.low <= value <= self.high:
            raise ValueError(f"expected a number from {self.low:g} to {self.high:g}")
        return value


@dataclass(frozen=True)
class Words:
    """One or more of the options, without repeats; a single one where ``single``."""

    default: tuple[str, ...]
    options: tuple[str, ...]
    single: bool = False

    def parse(self, text: str) -> Any:
        """The value, or ValueError with what was expected."""
        words = tuple(text.replace(",", " ").split())
        if not words or len(set(words)) != len(words) or not set(words) <= set(self.options):
            raise ValueError(f"expected {'one' if self.single else 'some'} of {', '.join(self.options)}")
        if self.single and len(words) != 1:
            raise ValueError(f"expected one of {', '.join(self.options)}")
        return words[0] if self.single else words


@dataclass(frozen=True)
class Series:
    """Numbers from low to high separated by spaces; 'auto' or an empty text is the empty series where ``auto``."""

    default: tuple[float, ...]
    low: float
    high: float
    whole: bool = True
    auto: bool = False
    rising: int = 0
    """1 if the numbers must rise, -1 if they must fall."""

    def parse(self, text: str) -> tuple[float, ...]:
        """The value, or ValueError with what was expected."""
        if self.auto and text.strip() in ("", "auto"):
            return ()
        kind = "integers" if self.whole else "numbers"
        expected = f"expected {kind} from {self.low:g} to {self.high:g}"
        expected += {0: "", 1: ", each larger than the one before", -1: ", each smaller than the one before"}[
            self.rising
        ]
        try:
            values = tuple((int if self.whole else float)(word) for word in text.replace(",", " ").split())
        except ValueError:
            raise ValueError(expected) from None
        if not values or not all(self.low <= value <= self.high for value in values):
            raise ValueError(expected)
        if self.rising and any((b - a) * self.rising <= 0 for a, b in pairwise(values)):
            raise ValueError(expected)
        return values


Entry = Whole | Real | Words | Series

_WEIGHT = {"low": 0.0, "high": 1000.0}

SCHEMA: Mapping[str, Mapping[str, Entry]] = {
    "evolve": {
        "generations": Whole(100, 0, 10_000_000),
        "frac_bits": Whole(8, *FRAC_BITS_RANGE),
        "input_scales": Series((), *SCALE_RANGE, auto=True),
        "input_limits": Series((), 1, SIGNAL_MAX, auto=True),
        "max_steps": Whole(0, 0, 10_000_000),
        "search_steps": Whole(0, 0, 10_000_000),
        "race_episodes": Series((1, 4, 16), 1, 10_000, rising=1),
        "race_fractions": Series((1.0, 0.25, 0.05), 1e-6, 1.0, whole=False, rising=-1),
        "selection_episodes": Whole(16, 1, 100_000),
        "finalists": Whole(5, 1, 1000),
        "final_episodes": Whole(64, 1, 100_000),
        "report_episodes": Whole(100, 1, 100_000),
        "fall_reward": Real(math.nan, -1e9, 1e9),
        "fall_value_start": Real(0.0, -1e9, 1e9),
        "fall_value_end": Real(0.0, -1e9, 1e9),
        "fall_ramp_start": Whole(0, 0, 10_000_000),
        "fall_ramp_end": Whole(0, 0, 10_000_000),
        "finish_bonus": Real(0.0, -1e9, 1e9),
        "stall_steps": Whole(0, 0, 10_000_000),
        "stall_gain": Real(0.0, 0.0, 1e9),
        "risk": Real(0.0, 0.0, 100.0),
        "size_pressure": Real(0.5, 0.0, 1.0),
        "max_total_steps": Whole(0, 0, 10**15),
        "new_seeds": Whole(1, 0, 1),
        "restart_after": Whole(0, 0, 1_000_000),
        "linear_generations": Whole(0, 0, 1_000_000),
        "linear_population": Whole(64, 4, 100_000),
        "linear_episodes": Whole(4, 1, 10_000),
        "linear_walks_at": Real(150.0, -1e9, 1e9),
    },
    "NEAT": {
        "pop_size": Whole(150, 2, 1_000_000),
        "genome": Words(("BitGenome",), ("BitGenome", "WeightAgnostic", "PlainGenome"), single=True),
        "reproduction": Words(
            ("BitReproduction",), ("BitReproduction", "PlainReproduction", "SoftmaxReproduction"), single=True
        ),
    },
    "BitGenome": {
        "activations": Words(("clamped", "hat", "step", "abs"), ACTIVATION_NAMES),
        "output_activation": Words(("clamped",), (*ACTIVATION_NAMES, "any"), single=True),
        "num_hidden": Whole(0, 0, 1000),
        "initial_links": Real(2.0, 0.0, 1000.0),
        "max_nodes": Whole(256, 1, 8000),
        "max_links": Whole(1024, 1, 100_000),
        "gain_min": Whole(-7, *GAIN_RANGE),
        "gain_max": Whole(7, *GAIN_RANGE),
        "gain_init_min": Whole(-1, *GAIN_RANGE),
        "gain_init_max": Whole(2, *GAIN_RANGE),
        "mutations": Real(2.0, 1.0, 100.0),
        "weight_zero_rate": Real(0.3, 0.0, 1.0),
        "mutate_weight": Real(3.0, **_WEIGHT),
        "mutate_gain": Real(3.0, **_WEIGHT),
        "mutate_bias": Real(0.0, **_WEIGHT),
        "mutate_activation": Real(0.7, **_WEIGHT),
        "mutate_delay": Real(0.0, **_WEIGHT),
        "mutate_add_link": Real(3.0, **_WEIGHT),
        "mutate_delete_link": Real(1.5, **_WEIGHT),
        "mutate_rewire": Real(2.0, **_WEIGHT),
        "mutate_split": Real(0.5, **_WEIGHT),
        "mutate_path": Real(0.7, **_WEIGHT),
        "mutate_delete_node": Real(0.3, **_WEIGHT),
        "mutate_bypass_node": Real(0.1, **_WEIGHT),
        "compatibility_disjoint_coefficient": Real(1.0, 0.0, 100.0),
        "compatibility_weight_coefficient": Real(0.5, 0.0, 100.0),
    },
    "WeightAgnostic": {
        "shared_weights": Series((-2.0, -1.0, -0.5, 0.5, 1.0, 2.0), -8.0, 8.0, whole=False, rising=1),
    },
    "PlainGenome": {
        "weights": Words(("float",), ("float", "integer", "ternary"), single=True),
        "initial_connection": Words(("full_direct",), ("full_direct", "unconnected"), single=True),
        "activations": Words(PAPER_ACTIVATIONS, ACTIVATION_NAMES),
        "activation_default": Words(("clamped",), (*ACTIVATION_NAMES, "random"), single=True),
        "activation_mutate_rate": Real(0.4, 0.0, 1.0),
        "conn_add_prob": Real(0.6, 0.0, 1.0),
        "conn_delete_prob": Real(0.4, 0.0, 1.0),
        "node_add_prob": Real(0.6, 0.0, 1.0),
        "node_delete_prob": Real(0.4, 0.0, 1.0),
        "enabled_mutate_rate": Real(0.01, 0.0, 1.0),
        "weight_init_stdev": Real(1.0, 0.0, 100.0),
        "weight_mutate_rate": Real(0.8, 0.0, 1.0),
        "weight_mutate_power": Real(0.5, 0.0, 100.0),
        "weight_replace_rate": Real(0.1, 0.0, 1.0),
        "weight_max": Real(30.0, 1.0, 128.0),
        "bias_init_stdev": Real(1.0, 0.0, 100.0),
        "bias_mutate_rate": Real(0.7, 0.0, 1.0),
        "bias_mutate_power": Real(0.5, 0.0, 100.0),
        "bias_replace_rate": Real(0.1, 0.0, 1.0),
        "bias_max": Real(30.0, 0.0, 128.0),
        "compatibility_disjoint_coefficient": Real(1.0, 0.0, 100.0),
        "compatibility_weight_coefficient": Real(0.5, 0.0, 100.0),
    },
    "BitSpeciesSet": {
        "compatibility_threshold": Real(3.0, 0.001, 100.0),
        "target_species": Whole(6, 1, 10_000),
        "threshold_trials": Whole(0, 0, 64),
    },
    "BitReproduction": {
        "elitism": Real(0.05, 0.0, 0.9),
        "survival_threshold": Real(0.25, 0.001, 1.0),
        "crossover": Real(0.15, 0.0, 1.0),
        "min_species_size": Whole(2, 1, 1000),
        "species_decay": Real(0.6, 0.01, 1.0),
        "tournament": Whole(2, 1, 100),
    },
    "PlainSpeciesSet": {
        "compatibility_threshold": Real(3.0, 0.01, 100.0),
    },
    "PlainReproduction": {
        "elitism": Whole(2, 0, 1000),
        "survival_threshold": Real(0.2, 0.001, 1.0),
        "min_species_size": Whole(2, 1, 1000),
        "max_stagnation": Whole(20, 1, 1_000_000),
        "species_elitism": Whole(2, 1, 1000),
    },
    "SoftmaxReproduction": {
        "beta": Real(0.03, 0.0, 1000.0),
        "survival_threshold": Real(1.0, 0.001, 1.0),
        "mutation_rate": Real(0.05, 0.0, 1.0),
        "elitism": Whole(0, 0, 1000),
    },
}

UNWEIGHTED = ("gain_min", "gain_max", "gain_init_min", "gain_init_max", "mutate_gain", "mutate_bias")
"""Keys of [BitGenome] that are 0 for WeightAgnostic, whatever they say: its topologies have no gains and no biases."""

SPECIES_SETS: Mapping[str, str] = {
    "BitReproduction": "BitSpeciesSet",
    "PlainReproduction": "PlainSpeciesSet",
    "SoftmaxReproduction": "PlainSpeciesSet",
}
"""How genomes are parted into species for each kind of reproduction."""

_ALWAYS = ("evolve", "NEAT")


def _in_use(sections: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The sections that the choices in [NEAT] make use of, in the schema's order."""
    chosen = {sections["NEAT"][key] for key in ("genome", "reproduction")}
    chosen.add(SPECIES_SETS[sections["NEAT"]["reproduction"]])
    if "WeightAgnostic" in chosen:
        chosen.add("BitGenome")  # which says how its topologies mutate
    return [name for name in SCHEMA if name in _ALWAYS or name in chosen]


PRESETS: Mapping[str, str] = {
    "BipedalWalker-v3": "bipedalwalker",
    "BipedalWalkerHardcore-v3": "hardcore",
    "LunarLander-v3": "lunarlander",
    "LunarLanderContinuous-v3": "lunarlander",
    "CartPole-v0": "cartpole",
    "CartPole-v1": "cartpole",
    "Acrobot-v1": "acrobot",
    "Pendulum-v1": "pendulum",
    "MountainCarContinuous-v0": "mountaincar",
}
"""The preset of each environment; `default` serves all others."""


@dataclass(frozen=True)
class Config:
    """A complete, checked configuration: every key of `SCHEMA` has a value."""

    sections: Mapping[str, Mapping[str, Any]]
    source: str = field(default="configuration", compare=False)
    """Where it came from, for messages; one of other values keeps it."""

    def __getitem__(self, section: str) -> Mapping[str, Any]:
        return self.sections[section]

    def with_values(self, section: str, **values: Any) -> Config:
        """The configuration with other values, which are checked again."""
        merged = {name: dict(entries) for name, entries in self.sections.items()}
        merged[section].update(values)
        return replace(parse(Config(merged).text, "command line"), source=self.source)

    @cached_property
    def text(self) -> str:
        """The whole configuration as an ini file: all keys of the sections in use, in the schema's order."""
        out = io.StringIO()
        for section in _in_use(self.sections):
            out.write(f"[{section}]\n")
            for key in SCHEMA[section]:
                out.write(f"{key} = {_shown(self.sections[section][key])}\n")
            out.write("\n")
        return out.getvalue().rstrip("\n") + "\n"


def preset_names() -> list[str]:
    """The shipped presets."""
    folder = resources.files("bitneat.evolve") / "presets"
    return sorted(entry.name[: -len(".ini")] for entry in folder.iterdir() if entry.name.endswith(".ini"))


def preset_for(spec: EnvironmentSpec) -> str:
    """The name of the preset for an environment."""
    if spec.id == "BipedalWalker-v3" and spec.kwargs.get("hardcore"):
        return "hardcore"
    return PRESETS.get(spec.id, "default")


def load(source: str) -> Config:
    """A configuration from a preset's name or a file.

    Raises:
        BitneatError: if it is neither, or anything in it is wrong.
    """
    if source in preset_names():
        text = (resources.files("bitneat.evolve") / "presets" / f"{source}.ini").read_text(encoding="utf-8")
        return parse(text, f"preset {source}")
    if not Path(source).exists():
        raise ConfigError(f"--config {source}: neither a file nor a preset (presets: {', '.join(preset_names())})")
    try:
        text = read_capped(source, MAX_CONFIG_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ConfigError(f"{source}: not a text file in UTF-8") from None
    return parse(text, source)


def parse(text: str, where: str) -> Config:
    """A configuration from the text of an ini file; keys that are not there take their defaults.

    Raises:
        BitneatError: naming ``where``, section, key and what was expected.
    """
    parser = configparser.ConfigParser(
        interpolation=None, default_section="\0", strict=True, inline_comment_prefixes=("#", ";")
    )
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    try:
        parser.read_string(text, source=where)
    except configparser.Error as error:
        raise ConfigError(f"{where}: {' '.join(str(error).split())}") from None
    for section in parser.sections():
        if section not in SCHEMA:
            raise ConfigError(f"{where}: unknown section [{section}] (known: {', '.join(SCHEMA)})")
        for key in parser[section]:
            if key not in SCHEMA[section]:
                raise ConfigError(f"{where}: [{section}] {key}: unknown key{_suggestion(key, SCHEMA[section])}")
    sections: dict[str, dict[str, Any]] = {}
    for section, entries in SCHEMA.items():
        sections[section] = {}
        for key, entry in entries.items():
            given = parser.get(section, key) if parser.has_option(section, key) else None
            try:
                sections[section][key] = entry.parse(_shown(entry.default) if given is None else given)
            except ValueError as error:
                raise ConfigError(f"{where}: [{section}] {key} = {given!s:.80}: {error}") from None
    _check_together(sections, where)
    _refuse_unused(parser, sections, where)
    return Config(sections, where)


def _refuse_unused(parser: configparser.ConfigParser, sections: Mapping[str, Mapping[str, Any]], where: str) -> None:
    """A section that nothing reads was meant for something else."""
    used = _in_use(sections)
    for section in parser.sections():
        if section not in used:
            raise ConfigError(f"{where}: [{section}] is not in use; what [NEAT] names reads {', '.join(used)}")


def _check_together(sections: Mapping[str, Mapping[str, Any]], where: str) -> None:
    evolve, genome = sections["evolve"], sections["BitGenome"]
    if len(evolve["race_episodes"]) != len(evolve["race_fractions"]):
        raise ConfigError(f"{where}: [evolve] race_fractions: expected as many numbers as race_episodes")
    if evolve["race_fractions"][0] != 1.0:
        raise ConfigError(
            f"{where}: [evolve] race_fractions: expected 1 first, since every genome runs the first stage"
        )
    for low, high in (("gain_min", "gain_max"), ("gain_init_min", "gain_init_max")):
        if genome[low] > genome[high]:
            raise ConfigError(f"{where}: [BitGenome] {low}: expected at most {high}")
    if genome["gain_init_min"] < genome["gain_min"] or genome["gain_init_max"] > genome["gain_max"]:
        raise ConfigError(f"{where}: [BitGenome] gain_init_min, gain_init_max: expected within gain_min..gain_max")
    without_effect = UNWEIGHTED if sections["NEAT"]["genome"] == "WeightAgnostic" else ()
    mutations = [key for key in genome if key.startswith("mutate_") and key not in without_effect]
    if not any(genome[key] for key in mutations):
        raise ConfigError(
            f"{where}: [BitGenome] mutate_*: expected at least one above 0"
            + (" besides mutate_gain and mutate_bias, which do nothing for WeightAgnostic" if without_effect else "")
        )
    if evolve["fall_ramp_end"] < evolve["fall_ramp_start"]:
        raise ConfigError(f"{where}: [evolve] fall_ramp_end: expected at least fall_ramp_start")
    _check_kinds(sections, where)


def _check_kinds(sections: Mapping[str, Mapping[str, Any]], where: str) -> None:
    """What the kinds of genome and reproduction ask of each other and of their sections."""
    evolve = sections["evolve"]
    neat = sections["NEAT"]
    if evolve["linear_generations"] and neat["genome"] != "BitGenome":
        raise ConfigError(f"{where}: [evolve] linear_generations: a linear start is for BitGenome")
    if evolve["restart_after"] and neat["genome"] != "BitGenome":
        raise ConfigError(f"{where}: [evolve] restart_after: restarts are for BitGenome")
    for key in ("min_species_size", "elitism"):
        value = sections[neat["reproduction"]].get(key, 0)
        if type(value) is int and value > neat["pop_size"]:
            raise ConfigError(f"{where}: [{neat['reproduction']}] {key}: expected at most pop_size")
    if (neat["genome"] == "PlainGenome") == (neat["reproduction"] == "BitReproduction"):
        raise ConfigError(
            f"{where}: [NEAT] reproduction: expected BitReproduction for BitGenome and WeightAgnostic,"
            " PlainReproduction or SoftmaxReproduction for PlainGenome"
        )
    for weight in sections["WeightAgnostic"]["shared_weights"]:
        if not _can_be_shared(weight):
            raise ConfigError(
                f"{where}: [WeightAgnostic] shared_weights: {_shown(weight)}: expected multiples of 1/128, none of them 0,"
                f" each a power of two times an integer from -{LARGEST_SHIFTED_WEIGHT} to {LARGEST_SHIFTED_WEIGHT}"
            )
    plain = sections["PlainGenome"]
    if plain["activation_default"] not in (*plain["activations"], "random"):
        raise ConfigError(f"{where}: [PlainGenome] activation_default: expected one of activations, or random")


def _can_be_shared(weight: float) -> bool:
    """Whether a weight is the gain of a node times what shifted links can add up to."""
    units = weight * 128
    if not units or units != int(units):
        return False
    odd = int(abs(units))
    while odd % 2 == 0:
        odd //= 2
    return odd <= LARGEST_SHIFTED_WEIGHT


def _suggestion(key: str, known: Mapping[str, Any]) -> str:
    import difflib

    close = difflib.get_close_matches(key, known, n=1)
    return f" (did you mean {close[0]}?)" if close else f" (known: {', '.join(known)})"


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return " ".join(_shown(entry) for entry in value) if value else "auto"
    if isinstance(value, float):
        return "none" if math.isnan(value) else f"{value!r}".removesuffix(".0")
    return str(value)
