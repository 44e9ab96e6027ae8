# SPDX-License-Identifier: MIT
"""The polishing search, on a landscape whose optimum is known, and its folder."""

import json
import random
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from bitneat.champion import EnvironmentSpec, load
from bitneat.controller import BoxAction, Controller, Input, Link, Node, Signal
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.evolve.polish import Entry, Goal, Polish, _Counter
from bitneat.evolve.polish_run import PolishFolder, PolishSettings, carry_on
from bitneat.evolve.randomness import REPORT_START, SELECTION_START, report_seeds, selection_seeds
from bitneat.evolve.search import Score
from bitneat.sim.environment import EpisodeResult, Shaping
from tests.sealed import sealed

NUM_INPUTS = 6
START = Controller(
    (Input(),) * NUM_INPUTS,
    tuple(
        Node(tuple(Link(i, 0, 0, 1 if (i + o) % 3 else -1) for i in range(NUM_INPUTS)), 0, 0, "clamped") for o in (0, 1)
    ),
    (Signal(NUM_INPUTS), Signal(NUM_INPUTS + 1)),
    8,
).canonical


class Landscape:
    """A reward that only three links are good for, with noise that depends on the seed and the controller alone."""

    WANTED = (frozenset({(0, 1), (3, -1)}), frozenset({(5, 1)}))

    def evaluate(
        self, controllers: Sequence[Controller], seeds: Sequence[int], shaping: Shaping | None = None
    ) -> list[list[EpisodeResult]]:
        assert shaping is None, "polishing looks at official rewards"
        assert all(seed >= 0 for seed in seeds)
        return [
            [EpisodeResult(r, r, 10, True, False) for r in (self.reward(c) + noise(c, seed) for seed in seeds)]
            for c in controllers
        ]

    def reward(self, controller: Controller) -> float:
        total = 0.0
        for output, wanted in zip(controller.outputs, self.WANTED, strict=True):
            if isinstance(output, Signal) and output.index >= NUM_INPUTS:
                links = controller.nodes[output.index - NUM_INPUTS].links
                found = {(link.source, link.sign) for link in links}
                total += 30.0 * len(found & wanted) - 2.0 * len(found - wanted)
        return total

    def close(self) -> None:
        pass


def noise(controller: Controller, seed: int) -> float:
    return random.Random(f"{controller.sha256} {seed}").gauss(0.0, 3.0)


def settings(objective: str, generations: int) -> PolishSettings:
    return PolishSettings(
        EnvironmentSpec("Landscape-v0"),
        BoxAction((-1.0, -1.0), (1.0, 1.0), (2,), "float32"),
        (START,),
        Goal(objective, 60.0),
        generations,
        seed=4,
        max_steps=10,
    )


def test_reward_finds_the_wanted_links() -> None:
    polish = Polish([START], Goal(), seed=1)
    rows = [polish.advance(Landscape()) for _ in range(12)]
    best = polish.ranking()[0]
    assert Landscape().reward(best.controller) >= 84.0  # one node for both outputs is nearly as good
    assert rows[-1].best > rows[0].best
    assert all(entry.episodes >= 3 for entry in polish.archive)


def test_size_shrinks_and_keeps_the_floor() -> None:
    polish = Polish([START], Goal("size", 60.0), seed=1)
    for _ in range(12):
        polish.advance(Landscape())
    best = polish.ranking()[0]
    assert best.size < len(pack(START))
    assert Landscape().reward(best.controller) >= 58.0
    sizes = [entry.size for entry in polish.front()]
    assert sizes == sorted(set(sizes))
    assert best.size == len(pack(best.controller))


def test_no_more_bytes_than_wanted() -> None:
    limited = Polish([START], Goal(max_bytes=8), seed=2)
    for _ in range(20):
        row = limited.advance(Landscape())
    best = limited.ranking()[0]
    assert best.size == row.best_bytes <= 8 < len(pack(START))
    assert any(entry.size > 8 for entry in limited.archive), "larger ones may have children that are small enough"
    assert Landscape().reward(best.controller) > Landscape().reward(START)


def test_risk_prefers_the_controller_that_never_falls() -> None:
    bold, safe = Entry(START), Entry(START)
    bold.add([340.0] * 99 + [-50.0])
    safe.add([322.0, 324.0] * 50)
    assert Goal().value(bold) > Goal().value(safe)
    assert Goal(risk=0.5).value(bold) < Goal(risk=0.5).value(safe)
    assert Goal(risk=0.5).value(safe) == pytest.approx(323.0 - 0.5 - 0.1)


@pytest.mark.parametrize(("risk", "kept"), [(0.0, {"bold", "safe"}), (0.5, {"safe"})])
def test_who_falls_loses_the_race_where_risk_matters(risk: float, kept: set[str]) -> None:
    def controller(sign: int) -> Controller:
        return Controller(START.inputs, (Node((Link(0, 0, 0, sign),), 0, 0, "clamped"),), (Signal(6), Signal(6)), 8)

    named = {controller(1).canonical.sha256: "bold", controller(-1).canonical.sha256: "safe"}

    class Falls(Landscape):
        """The bold one earns as much in the mean, and falls in every fourth episode."""

        def evaluate(
            self, controllers: Sequence[Controller], seeds: Sequence[int], shaping: Shaping | None = None
        ) -> list[list[EpisodeResult]]:
            bold = [100.0 - 80.0 * (n % 4 == 3) for n in range(len(seeds))]
            rewards = {"bold": [r + 20.0 for r in bold], "safe": [100.0] * len(seeds)}
            rows = [rewards.get(named.get(c.sha256, ""), [95.0] * len(seeds)) for c in controllers]
            return [[EpisodeResult(r, r, 10, True, False) for r in row] for row in rows]

    polish = Polish([START], Goal(risk=risk), seed=1)
    polish.archive[0].add([95.0] * 200)
    polish._race([Entry(controller(sign).canonical) for sign in (1, -1)], polish._stages(), _Counter(Falls()))
    assert {named[e.controller.sha256] for e in polish.archive if e.controller.sha256 in named} == kept


def test_where_falls_matter_hundreds_of_episodes_are_run_before_a_controller_is_kept() -> None:
    polish = Polish([START], Goal(risk=0.5), seed=1)
    for _ in range(3):
        polish.advance(Landscape())
    assert min(entry.episodes for entry in polish.archive) > 200


@pytest.mark.parametrize(("deviation", "least"), [(10.0, 60), (30.0, 200), (80.0, 600)])
def test_the_more_rewards_vary_the_more_episodes_are_run_before_a_controller_is_kept(
    deviation: float, least: int
) -> None:
    class Varying(Landscape):
        def evaluate(
            self, controllers: Sequence[Controller], seeds: Sequence[int], shaping: Shaping | None = None
        ) -> list[list[EpisodeResult]]:
            noise = [deviation if seed % 2 else -deviation for seed in seeds]
            rows = super().evaluate(controllers, seeds, shaping)
            return [[replace(e, reward=e.reward + x) for e, x in zip(row, noise, strict=True)] for row in rows]

    polish = Polish([START], Goal(), seed=1)
    for _ in range(4):
        polish.advance(Varying())
    assert (
        least < min(entry.episodes for entry in polish.archive if entry.controller != START.canonical) < 3 * least + 100
    )


@pytest.mark.parametrize(
    "values", [{"objective": "speed"}, {"floor": float("nan")}, {"max_bytes": 0}, {"max_bytes": True}, {"risk": -1.0}]
)
def test_a_goal_that_cannot_be_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(BitneatError, match=f"^{next(iter(values))}: expected"):
        Goal(**values)


def test_a_lucky_start_loses_its_place() -> None:
    polish = Polish([START], Goal(), seed=1)
    polish.advance(Landscape())
    luck = polish.archive[0]
    luck.total, luck.squares, luck.episodes = 400.0, 160000.0, 1
    for _ in range(25):
        polish.advance(Landscape())
    assert polish.ranking()[0].mean < 110.0


@pytest.mark.parametrize("objective", ["reward", "size"])
def test_a_run_that_is_stopped_and_resumed_ends_the_same(tmp_path: Path, objective: str) -> None:
    ends = []
    for stop_after in (5, 2):
        folder = PolishFolder(tmp_path / f"{stop_after}")
        folder.create()
        asked = settings(objective, stop_after)
        polish = Polish(asked.start, asked.goal, asked.seed)
        carry_on(folder, asked, polish, [], Landscape(), tell=lambda row: None)
        if stop_after < 5:
            _, polish, history = folder.load()
            asked = settings(objective, 5)
            assert len(history) == stop_after
            carry_on(folder, asked, polish, history, Landscape(), tell=lambda row: None)
        ends.append({path.name: path.read_bytes() for path in folder.path.iterdir()})
    assert ends[0] == ends[1]


def test_the_front_is_written_as_champions_with_scores(tmp_path: Path) -> None:
    folder = PolishFolder(tmp_path)
    folder.create()
    asked = settings("size", 7)
    polish = Polish(asked.start, asked.goal, asked.seed)
    (tmp_path / "front").mkdir()
    (tmp_path / "front" / "1.pkl").write_bytes(b"of before")
    (tmp_path / "front" / f".22.pkl.{2**31 - 1}.0123abcd.tmp").write_bytes(b"of a process that died")
    carry_on(folder, asked, polish, [], Landscape(), tell=lambda row: None, front=True)
    found = {int(path.stem): load(path) for path in (tmp_path / "front").iterdir()}
    assert found.keys() == {entry.size for entry in polish.front()}
    assert len(found) > 1
    for size, champion in found.items():
        assert len(pack(champion.controller)) == size
        score = Score.of(Landscape().evaluate([champion.controller], report_seeds(100))[0])
        assert champion.provenance["held_out"] == {**score.to_data(), "first_seed": REPORT_START}


def test_the_champions_score_is_rounded_once_as_every_score_is(tmp_path: Path) -> None:
    """Python's own sum rounds each addition up to 3.11 and compensates from 3.12 on."""
    folder = PolishFolder(tmp_path)
    folder.create()
    asked = settings("reward", 1)
    polish = Polish(asked.start, asked.goal, asked.seed)
    champion, _, _ = carry_on(folder, asked, polish, [], Landscape(), tell=lambda row: None)
    episodes = Landscape().evaluate([champion.controller], selection_seeds(200))[0]
    assert champion.provenance["selection"] == {**Score.of(episodes).to_data(), "first_seed": SELECTION_START}


def test_settings_survive_the_file(tmp_path: Path) -> None:
    folder = PolishFolder(tmp_path / "run")
    folder.create()
    asked = settings("size", 1)
    polish = Polish(asked.start, asked.goal, asked.seed)
    folder.save(asked, polish_after_a_generation(polish), [])
    loaded, *_ = folder.load()
    assert asdict(loaded) == asdict(asked)


def polish_after_a_generation(polish: Polish) -> Polish:
    polish.advance(Landscape())
    return polish


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("format",), "bitneat-run"),
        (("version",), 0),
        (("settings", "objective"), "speed"),
        (("settings", "floor"), "high"),
        (("settings", "max_bytes"), 0),
        (("settings", "risk"), -0.5),
        (("settings", "generations"), -1),
        (("settings", "start"), []),
        (("search", "archive"), []),
        (("search", "archive", 0, "episodes"), 0),
        (("search", "archive", 0, "total"), "much"),
        (("search", "archive", 0, "controller"), {}),
        (("search", "random"), [3, [1, 2], None]),
        (("history",), [[1]]),
    ],
)
def test_a_damaged_file_is_one_line(tmp_path: Path, path: tuple[str | int, ...], value: object) -> None:
    folder = PolishFolder(tmp_path / "run")
    folder.create()
    asked = settings("reward", 1)
    polish = polish_after_a_generation(Polish(asked.start, asked.goal, asked.seed))
    folder.save(asked, polish, [])
    file = folder.path / "polish.json"
    data = json.loads(file.read_text())
    inner = data
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    file.write_text(sealed(data))
    with pytest.raises(BitneatError, match=r"polish\.json: damaged: [^\n]*$"):
        folder.load()


def test_a_folder_with_a_run_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(BitneatError, match="holds a run already"):
        PolishFolder(tmp_path).create()
    with pytest.raises(BitneatError, match="holds no polishing run"):
        PolishFolder(tmp_path).load()
