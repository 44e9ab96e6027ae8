# SPDX-License-Identifier: MIT
"""Tables, claims and the list of jobs, on results made up for the purpose."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bitneat.errors import BitneatError
from bitneat.evolve.config import load as load_config
from bitneat.reproduce.claims import UNTESTED, claims
from bitneat.reproduce.experiments import BASELINES, BUDGETS, SCENARIOS, SYSTEMS, jobs
from bitneat.reproduce.results import Result, load, load_all
from bitneat.reproduce.running import best_cell, configuration, mismatch
from bitneat.reproduce.tables import grid, markdown, quantization, scenarios, table_one, tables
from tests.sealed import sealed

SCORE = {"episodes": 100, "mean": 10.0, "std": 1.0, "min": 5.0, "max": 12.0}


def result(job: str, mean: float = 10.0, **more: Any) -> Result:
    entries: dict[str, Any] = {
        "group": "table", "system": job.rsplit("-", 1)[0], "seed": 1, "command": f"bitneat reproduce --only {job}",
        "config": {}, "heldout": {**SCORE, "mean": mean}, "hardcore": {**SCORE, "mean": mean - 50},
        "episodes": 300_000, "steps": 10**8, "generations": 300, "nodes": 8, "links": 40, "packed_bytes": 50,
        "float_bytes": None, "paper_max": mean + 20, "paper_nodes": 40, "paper_links": 101,
        "history": {"best": [1.0, 2.0, mean]},
    }  # fmt: skip
    return Result(job=job, **{**entries, **more})


def collect(*results: Result) -> dict[str, Result]:
    return {entry.job: entry for entry in results}


def verdict(results: dict[str, Result], words: str) -> str:
    (found,) = [claim for claim in claims(results) if words in claim.claim]
    return found.verdict


def rows(table: Any) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(table.to_csv().decode())))


@pytest.mark.parametrize("budget", BUDGETS.values(), ids=lambda budget: budget.name)
def test_every_budget_has_every_system_and_needs_nothing_that_it_lacks(budget: Any) -> None:
    found = jobs(budget)
    names = [job.name for job in found]
    assert len(set(names)) == len(names)
    for place, job in enumerate(found):
        assert set(job.after) <= set(names) - {job.name}, job
        if job.group == "quantization":
            assert set(job.after) <= set(names[:place])
    assert {job.system for job in found} >= {*SYSTEMS, *BASELINES, "ptq-int", "ptq-ternary", "ars-ternary"}


def test_the_papers_budget_is_the_papers() -> None:
    found = {job.name: job for job in jobs(BUDGETS["paper"])}
    for name in ("default-3", "bit-3", "int-1", "softmax-1"):
        config = configuration(found[name], {**GRID})
        assert config["NEAT"]["pop_size"] == 200
        assert config["evolve"]["generations"] == 300
        assert config["evolve"]["race_episodes"] == (5,)
        assert not config["evolve"]["stall_steps"]
    wann = configuration(found["wann-1"], {})
    shared = len(wann["WeightAgnostic"]["shared_weights"])
    assert wann["evolve"]["generations"] * shared * wann["evolve"]["race_episodes"][0] == 300 * 5
    for count in SCENARIOS:
        evolve = configuration(found[f"scenarios-{count}-1"], {})["evolve"]
        assert evolve["generations"] * evolve["race_episodes"][0] == 150  # a tenth of 300 * 5


GRID = collect(
    *(
        result(
            f"grid-{threshold:g}-{beta:g}-{seed}", mean=threshold, group="grid", system="softmax",
            notes={"selection": {"mean": 100 * beta - threshold}},
        )
        for threshold in (1.0, 0.5, 0.1) for beta in (0.005, 0.03, 0.09) for seed in (1, 2)
    )
)  # fmt: skip


def test_softmax_runs_in_the_cell_that_the_selection_seeds_prefer() -> None:
    assert best_cell(GRID) == (0.1, 0.09)  # by held-out means it would be another
    job = next(job for job in jobs(BUDGETS["paper"]) if job.name == "softmax-1")
    assert set(job.after) > set(GRID)
    config = configuration(job, GRID)
    assert (config["SoftmaxReproduction"]["survival_threshold"], config["SoftmaxReproduction"]["beta"]) == (0.1, 0.09)


def test_bit_gains_may_take_the_steps_of_the_bit_run_of_its_seed() -> None:
    job = next(job for job in jobs(BUDGETS["paper"]) if job.name == "bit-gains-2")
    config = configuration(job, collect(result("bit-2", steps=123_456)))
    assert config["evolve"]["max_total_steps"] == 123_456
    preset = load_config("paper-bit-gains")
    assert config.with_values("evolve", max_total_steps=270_000_000).text == preset.text


def test_a_result_of_another_experiment_is_told_from_the_jobs_own() -> None:
    found = {job.name: job for job in jobs(BUDGETS["paper"])}
    text = configuration(found["bit-1"], {}).text
    assert mismatch(result("bit-1", config={"text": text}), found["bit-1"], {}) is None
    other = mismatch(result("bit-1", config={"text": text.replace("0.6", "0.7")}), found["bit-1"], {})
    assert other == "has another configuration"
    fewer = result("bit-1", config={"text": text}, heldout={**SCORE, "episodes": 10})
    assert mismatch(fewer, found["bit-1"], {}) == "was scored over 10 episodes, not 100"

    gains = found["bit-gains-1"]
    bit = result("bit-1", steps=1000)
    text = configuration(gains, collect(bit)).text
    assert mismatch(result("bit-gains-1", config={"text": text}), gains, collect(bit)) is None
    later = collect(replace(bit, steps=1001))
    assert mismatch(result("bit-gains-1", config={"text": text}), gains, later) == "has another configuration"

    search = found["ptq-ternary-search-1"]
    config = {"to": "ternary", "method": "search", "source": "default-1"}
    source = result("default-1", 12.0)
    rounded = result(
        "ptq-ternary-search-1", config=config, notes={"how": {"generations": 20}, "before": source.heldout}
    )
    assert mismatch(rounded, search, collect(source)) is None
    other = mismatch(rounded, search, collect(result("default-1", 13.0)))
    assert other == "is of another default-1 than there is now"
    assert mismatch(result("bit-1", config={}), found["bit-1"], {}) == "has no configuration"
    for generations, expected in ((20, None), (5, "searched for 5 generations, not 20")):
        tried = result("ptq-ternary-search-1", config=config, notes={"how": {"generations": generations}})
        assert mismatch(tried, search, {}) == expected
    renamed = result("ptq-ternary-search-1", config={**config, "source": "default-2"}, notes={"how": {}})
    assert mismatch(renamed, search, {}) == "quantizes something else, or in another way"
    assert mismatch(result("ars-0", steps=2_000_000), found["ars-0"], {}) == "took 2000000 steps, not 20000000"


def test_table_one_shows_the_median_run_and_the_spread() -> None:
    table = table_one(collect(result("bit-1", 30.0), result("bit-2", 10.0), result("bit-3", 20.0)))
    (row,) = rows(table)
    assert (row["system"], row["heldout_mean"], row["worst_run_mean"], row["best_run_mean"]) == (
        "bit",
        "20",
        "10",
        "30",
    )
    assert (row["runs"], row["paper_max"], row["packed_bytes"], row["float_bytes"]) == ("3", "40", "50", "")
    assert row["best_run_paper_max"] == "50"


def test_the_row_of_ars_in_ternary_is_the_quantization_with_gains() -> None:
    results = collect(
        result("ars-ternary-gains-0", 300.0, system="ars-ternary", group="quantization"),
        result("ars-ternary-round-0", -50.0, system="ars-ternary", group="quantization"),
    )
    assert [(row["heldout_mean"], row["runs"]) for row in rows(table_one(results))] == [("300", "1")]


def test_only_walkers_tell_of_the_hardcore_terrain() -> None:
    standing = result("bit-1", 10.0, hardcore={**SCORE, "mean": 9.0})
    assert verdict(collect(standing), "hardcore") == UNTESTED
    walking = result("default-1", 250.0, hardcore={**SCORE, "mean": -50.0})
    assert verdict(collect(standing, walking), "hardcore") == "does not hold"


def test_tables_have_rows_for_what_was_measured_only() -> None:
    assert [table.rows for table in tables({})] == [()] * len(tables({}))
    assert len(grid(GRID).rows) == 9
    results = collect(
        result(
            "ptq-int-round-1", 8.0, system="ptq-int", group="quantization", notes={"before": {**SCORE, "mean": 12.0}}
        ),
        result(
            "ptq-int-gains-1", 11.0, system="ptq-int", group="quantization", notes={"before": {**SCORE, "mean": 12.0}}
        ),
    )
    assert [(row["weights"], row["method"], row["heldout_mean"]) for row in rows(quantization(results))] == [
        ("int", "after training of default: round", "8"),
        ("int", "after training of default: gains", "11"),
    ]
    assert [row["system"] for row in rows(table_one(results))] == ["ptq-int"]


def test_claims_are_judged_by_their_rules() -> None:
    results = collect(result("bit-1", 260.0), result("bit-2", 250.0), result("bit-3", 255.0))
    assert verdict(results, "254.29") == "holds"
    assert verdict(collect(result("bit-1", 250.0, paper_max=280.0)), "254.29") == "does not hold"
    assert verdict({}, "254.29") == UNTESTED
    assert verdict(results, "22 bytes") == "does not hold"
    assert verdict(collect(result("bit-1", packed_bytes=21)), "22 bytes") == "holds"
    for after, expected in ((83.0, "holds"), (97.0, "does not hold"), (60.0, "does not hold")):
        notes, config = {"before": {**SCORE, "mean": 100.0}}, {"source": "ars-0"}
        rounded = result("ars-int-round-0", after, group="quantization", notes=notes, config=config)
        assert verdict(collect(rounded), "17 %") == expected
    pair = collect(result("int-1", 95.0), result("default-1", 100.0))
    assert verdict(pair, "as good as the float") == "holds"
    assert verdict(collect(result("int-1", 80.0), result("default-1", 100.0)), "as good as") == "does not hold"


def test_bit_is_ahead_only_if_it_is_in_every_generation() -> None:
    ahead = collect(result("bit-1", history={"best": [2.0, 3.0]}), result("default-1", history={"best": [1.0, 2.5]}))
    assert verdict(ahead, "ahead") == "holds"
    behind = {**ahead, "default-1": replace(ahead["default-1"], history={"best": [1.0, 3.5]})}
    assert verdict(behind, "ahead") == "does not hold"


def test_more_scenarios_help_only_if_each_step_does() -> None:
    def runs(*means: float) -> dict[str, Result]:
        pairs = zip(SCENARIOS, means, strict=False)
        return collect(*(result(f"scenarios-{n}-1", m, group="scenarios", system="bit") for n, m in pairs))

    assert verdict(runs(1, 2, 3, 4), "scenarios") == "holds"
    assert verdict(runs(1, 3, 2, 4), "scenarios") == "does not hold"
    assert verdict(runs(1, 2, 3), "scenarios") == UNTESTED
    assert [row["scenarios"] for row in rows(scenarios(runs(1, 2, 3)))] == ["1", "3", "5"]


def test_a_result_comes_back_from_its_file(tmp_path: Path) -> None:
    saved = result("bit-1", growth=({"generation": 3, "policy": {"controller": {}}},))
    saved.save(tmp_path / "bit-1.json")
    assert load(tmp_path / "bit-1.json") == saved


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"format": "other"}', '{"format": "bitneat-reproduction", "more": 1}', "{}"]
)
def test_a_damaged_result_is_refused_by_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bit-1.json"
    path.write_text(text)
    with pytest.raises(BitneatError, match=r"bit-1\.json"):
        load(path)
    path.write_text(json.dumps({"format": "bitneat-reproduction", "job": "x"}))
    with pytest.raises(BitneatError, match="damaged"):
        load(path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("job", []), ("job", None), ("seed", "1"), ("steps", -1), ("steps", True), ("links", 1.5), ("packed_bytes", "50"),
        ("paper_max", [1]), ("config", []), ("heldout", {}), ("heldout", None), ("heldout", {**SCORE, "episodes": "100"}),
        ("heldout", {**SCORE, "mean": float("nan")}), ("heldout", {**SCORE, "mean": 10**400}), ("hardcore", {"mean": 1.0}),
        ("history", {"best": 1.0}), ("history", {"best": ["a"]}), ("growth", {}), ("growth", [{"generation": 1}]),
        ("policy", {"controller": 1}), ("policy", {}), ("notes", []), ("notes", {"how": []}), ("notes", {"before": {}}),
    ],
)  # fmt: skip
def test_a_field_that_cannot_be_is_one_line_that_names_it(tmp_path: Path, name: str, value: object) -> None:
    path = tmp_path / "bit-1.json"
    result("bit-1").save(path)
    assert load(path).job == "bit-1"
    path.write_text(sealed({**json.loads(path.read_text()), name: value}))
    with pytest.raises(BitneatError, match=rf"bit-1\.json: damaged: {name}: expected [^\n]*$"):
        load(path)


def test_a_copy_of_a_result_under_another_name_does_not_count_in_its_place(tmp_path: Path) -> None:
    result("bit-1", 10.0).save(tmp_path / "bit-1.json")
    assert load_all(tmp_path)["bit-1"].heldout["mean"] == 10.0
    result("bit-1", 99.0).save(tmp_path / "bit-1_backup.json")
    with pytest.raises(
        BitneatError, match=r"bit-1_backup\.json: is the result of 'bit-1'; expected it in a file of that name"
    ):
        load_all(tmp_path)


def test_the_committed_results_are_read() -> None:
    assert len(load_all(Path(__file__).parents[2] / "docs" / "paper" / "results")) > 50


def test_a_page_shows_numbers_as_people_read_them() -> None:
    text = markdown(table_one(collect(result("bit-1", 30.04))), ("system", "heldout_mean", "episodes", "float_bytes"))
    assert text.splitlines()[-1] == "| bit | 30.0 | 300,000 |  |"
