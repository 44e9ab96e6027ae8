# SPDX-License-Identifier: MIT
"""Polishing: a search by small changes from controllers that work, for more reward, or for fewer bytes at the same reward.

An archive keeps, for every packed size, the few best controllers found so far. A generation varies those worth varying and lets
the children race: all run a few episodes, and whoever falls behind the best controller of its size or smaller is dropped, so that
most of the episodes go to the few that may be better. Episodes are new in every generation; what is in the archive is evaluated
on and on, so that a lucky one loses its place.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from bitneat.controller import Controller
from bitneat.controller.packing import pack
from bitneat.errors import BitneatError
from bitneat.evolve.evaluation import Evaluator
from bitneat.evolve.randomness import SELECTION_START
from bitneat.evolve.variation import vary

OBJECTIVES = ("reward", "size")

_CHILDREN = 160
Stage = tuple[int, int, float]
_RACE: Sequence[Stage] = ((3, 32, 60.0), (6, 12, 12.0), (14, 6, 4.0), (40, 4, 1.0))
"""More episodes, how many go on at most, and how far behind they may be."""
_LONGER = ((25.0, (140, 4, 1.0)), (45.0, (400, 2, 1.0)))
"""How the race goes on where the best controller's rewards deviate by so much: sixty episodes would be wrong by more than what
most changes are worth, and the lucky ones would take the archive over. The first is run wherever falls matter, too: what enters the
archive has shown in some two hundred episodes how often it falls."""
_PARENTS = 10
_PER_SIZE = 4
_PARENT_EPISODES = 6
_CAREFUL_PARENT_EPISODES = 20
_MOST_EPISODES = 3000
"""A fall in a thousand episodes is seen only by who looks at thousands; the parents alone are evaluated that often."""
_FIRST_EPISODES = 32
_CAREFUL_FIRST_EPISODES = 200
_NEAR = 25.0
"""Controllers this far below the floor may still have children that are above it."""
_SLIGHTLY = 4.0
_EXCESS = 0.5
"""Reward that a byte beyond the largest size wanted counts as: such a controller may have children that are small enough."""
_MEAN_CHANGES = (1.0, 1.5, 2.5)


@dataclass(frozen=True)
class Goal:
    """What a polishing run looks for.

    Args:
        objective: "reward" looks for the highest mean, "size" for the fewest packed bytes whose mean is at least ``floor``.
        floor: what "size" must not fall below.
        max_bytes: packed bytes that the champion may have at most.
        risk: standard deviations of an episode's reward that a mean loses wherever means are compared: 0 weighs a fall as what
            it costs, more makes falls rare.

    Raises:
        BitneatError: if a value cannot be.
    """

    objective: str = "reward"
    floor: float = 0.0
    max_bytes: int | None = None
    risk: float = 0.0

    def __post_init__(self) -> None:
        if self.objective not in OBJECTIVES:
            raise BitneatError(f"objective: expected {' or '.join(OBJECTIVES)}")
        for name, value in (("floor", self.floor), ("risk", self.risk)):
            if type(value) not in (int, float) or not math.isfinite(value):
                raise BitneatError(f"{name}: expected a finite number")
        if self.risk < 0:
            raise BitneatError("risk: expected a number of at least 0")
        if self.max_bytes is not None and (type(self.max_bytes) is not int or self.max_bytes < 1):
            raise BitneatError("max_bytes: expected a whole number above 0")

    def excess(self, size: int) -> int:
        """Bytes more than wanted."""
        return 0 if self.max_bytes is None else max(size - self.max_bytes, 0)

    def seeming(self, entry: Entry) -> float:
        """What a controller seems to be worth: the mean less ``risk`` standard deviations."""
        return entry.mean - self.risk * entry.std

    def value(self, entry: Entry) -> float:
        """That less one standard error, so that few episodes count for less.

        It is no bound: who has not fallen in the episodes so far has a small deviation, and may fall in the next.
        """
        return self.seeming(entry) - entry.std / math.sqrt(entry.episodes)


@dataclass
class Entry:
    """A controller with what its episodes came to."""

    controller: Controller
    episodes: int = 0
    total: float = 0.0
    squares: float = 0.0
    worst: float = math.inf
    size: int = field(init=False)

    def __post_init__(self) -> None:
        self.size = len(pack(self.controller))

    def add(self, rewards: Sequence[float]) -> None:
        """Take note of more episodes."""
        for reward in rewards:
            self.episodes += 1
            self.total += reward
            self.squares += reward * reward
            self.worst = min(self.worst, reward)

    @property
    def mean(self) -> float:
        """Mean official reward."""
        return self.total / self.episodes

    @property
    def std(self) -> float:
        """Standard deviation of the official reward."""
        return math.sqrt(max(self.squares / self.episodes - self.mean**2, 0.0))

    def to_data(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "controller": self.controller.to_data(),
            "episodes": self.episodes,
            "total": self.total,
            "squares": self.squares,
            "worst": self.worst,
        }

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Entry:
        """Read what `to_data` wrote.

        Raises:
            BitneatError: if a number cannot be.
        """
        entry = cls(Controller.from_data(data["controller"]))
        entry.episodes, entry.total, entry.squares, entry.worst = (
            data[key] for key in ("episodes", "total", "squares", "worst")
        )
        if type(entry.episodes) is not int or entry.episodes < 1:
            raise BitneatError("archive: expected a number of episodes above 0")
        if not all(type(v) in (int, float) and math.isfinite(v) for v in (entry.total, entry.squares, entry.worst)):
            raise BitneatError("archive: expected finite rewards")
        return entry


@dataclass(frozen=True)
class Row:
    """What a generation came to; a row of history.csv."""

    generation: int
    best: float
    """Mean of the controller whose `Goal.value` is highest, of those that are small enough if any is."""
    best_bytes: int
    smallest: int | None
    """Fewest packed bytes at or above the floor."""
    smallest_mean: float | None
    archive: int
    episodes: int
    steps: int


class Polish:
    """The state of a polishing run.

    Args:
        controllers: where to start; at least one.
        goal: what to look for.
        seed: of all randomness.
    """

    def __init__(self, controllers: Sequence[Controller], goal: Goal, seed: int) -> None:
        self.goal = goal
        self.generation = 0
        self.archive = [Entry(controller.canonical) for controller in controllers]
        self._random = random.Random(f"bitneat polish {seed}")
        self._fresh = True

    def advance(self, evaluator: Evaluator) -> Row:
        """Run one generation."""
        counter = _Counter(evaluator)
        if self._fresh:
            self._evaluate(self.archive, _FIRST_EPISODES, counter)
            if len(self._stages()) > len(_RACE):
                self._evaluate(self.archive, _CAREFUL_FIRST_EPISODES, counter)
            self._fresh = False
        parents = self._parents()
        stages = self._stages()
        self._race(self._children(parents), stages, counter)
        more = _PARENT_EPISODES if len(stages) == len(_RACE) else _CAREFUL_PARENT_EPISODES
        self._evaluate([p for p in parents if p.episodes < _MOST_EPISODES], more, counter)
        self._tidy()
        self.generation += 1
        return self._row(counter)

    def ranking(self) -> list[Entry]:
        """The archive, what the goal asks for first."""
        return sorted(self.archive, key=self._rank)

    def _rank(self, entry: Entry) -> tuple[bool, bool, float, float]:
        value, large = self.goal.value(entry), self.goal.excess(entry.size) > 0
        if self.goal.objective == "reward":
            return large, False, 0.0, -self._worth(entry)
        above = value >= self.goal.floor
        return large, not above, entry.size if above else 0, -value

    def _worth(self, entry: Entry) -> float:
        """The value, less what bytes beyond the largest size wanted count as."""
        return self.goal.value(entry) - _EXCESS * self.goal.excess(entry.size)

    def front(self) -> list[Entry]:
        """The controllers that no smaller one equals, the smallest first."""
        best, front = -math.inf, []
        for entry in sorted(self.archive, key=lambda e: (e.size, -self.goal.value(e))):
            if self.goal.value(entry) > best:
                front.append(entry)
                best = self.goal.value(entry)
        return front

    def _parents(self) -> list[Entry]:
        goal = self.goal
        if goal.objective == "reward":
            return sorted(self.archive, key=lambda e: -self._worth(e))[:_PARENTS]
        near = [e for e in self.archive if goal.value(e) >= goal.floor - _NEAR] or self.ranking()[:_PER_SIZE]
        # A reward above the floor is worth a little, since the next byte will cost some of it.
        return sorted(near, key=lambda e: e.size - 0.15 * min(goal.value(e) - goal.floor, 10.0))[:_PARENTS]

    def _children(self, parents: list[Entry]) -> list[Entry]:
        known = {entry.controller.sha256 for entry in self.archive}
        largest = max(parent.size for parent in parents) + 3
        children: list[Entry] = []
        for _ in range(20 * _CHILDREN):
            if len(children) == _CHILDREN:
                break
            parent = parents[min(self._random.randrange(len(parents)), self._random.randrange(len(parents)))]
            controller = vary(parent.controller, self._random, self._random.choice(_MEAN_CHANGES))
            if controller.sha256 in known:
                continue
            known.add(controller.sha256)
            child = Entry(controller)
            if self.goal.objective == "reward" or child.size <= largest:
                children.append(child)
        return children

    def _stages(self) -> Sequence[Stage]:
        """More episodes, how many children go on at most, and how far behind they may be."""
        deviation = min(self.archive, key=self._rank).std
        if self.goal.risk:
            deviation = max(deviation, _LONGER[0][0])
        return [*_RACE, *(stage for least, stage in _LONGER if deviation >= least)]

    def _race(self, children: list[Entry], stages: Sequence[Stage], counter: _Counter) -> None:
        wanted = {child.size: self._to_beat(child.size) for child in children}
        for episodes, most, behind in stages:
            if not children:
                return
            self._evaluate(children, episodes, counter)
            children.sort(key=lambda e: wanted[e.size] - self.goal.seeming(e))
            children = [e for e in children[:most] if wanted[e.size] - self.goal.seeming(e) < behind]
        self.archive += children

    def _to_beat(self, size: int) -> float:
        """What a child of this size must reach to be of interest: the best reward of the archive in no more bytes.

        "reward" lets a smaller one be a little worse than the best, and "size" asks for no more than the floor and a little.
        """
        goal = self.goal
        best = max((goal.value(entry) for entry in self.archive if entry.size <= size), default=-math.inf)
        if goal.objective == "reward":
            return max(best, max(map(self._worth, self.archive)) - _SLIGHTLY + _EXCESS * goal.excess(size))
        return min(max(best, goal.floor - _NEAR), goal.floor + _SLIGHTLY)

    def _tidy(self) -> None:
        by_size: dict[int, list[Entry]] = {}
        for entry in self.archive:
            by_size.setdefault(entry.size, []).append(entry)
        best, kept = -math.inf, []
        for size in sorted(by_size):
            entries = sorted(by_size[size], key=lambda e: -self.goal.value(e))[:_PER_SIZE]
            kept += [e for e in entries if self.goal.value(e) > best - 6.0]
            best = max(best, self.goal.value(entries[0]))
        self.archive = kept

    def _evaluate(self, entries: list[Entry], episodes: int, counter: _Counter) -> None:
        if entries:
            seeds = self._random.sample(range(SELECTION_START), episodes)
            for entry, rewards in zip(entries, counter.rewards([e.controller for e in entries], seeds), strict=True):
                entry.add(rewards)

    def _row(self, counter: _Counter) -> Row:
        goal = self.goal
        best = min(self.archive, key=lambda e: (goal.excess(e.size) > 0, -self._worth(e)))
        above = [e for e in self.archive if goal.value(e) >= goal.floor]
        smallest = min(above, key=lambda e: (e.size, -goal.value(e))) if above else None
        return Row(
            self.generation,
            best.mean,
            best.size,
            smallest.size if smallest else None,
            smallest.mean if smallest else None,
            len(self.archive),
            counter.episodes,
            counter.steps,
        )

    def to_data(self) -> dict[str, Any]:
        """Everything a checkpoint needs, as plain data."""
        version, numbers, gauss = self._random.getstate()
        return {
            "generation": self.generation,
            "fresh": self._fresh,
            "random": [version, list(numbers), gauss],
            "archive": [entry.to_data() for entry in self.archive],
        }

    def restore(self, data: Mapping[str, Any]) -> None:
        """Continue where `to_data` was taken.

        Raises:
            BitneatError: if a number is out of its range. Whatever else is wrong raises whatever it may.
        """
        version, numbers, gauss = data["random"]
        self._random.setstate((version, tuple(numbers), gauss))
        self.generation = data["generation"]
        if type(self.generation) is not int or self.generation < 0:
            raise BitneatError("generation: expected a whole number")
        self._fresh = bool(data["fresh"])
        self.archive = [Entry.from_data(entry) for entry in data["archive"]]
        if not self.archive:
            raise BitneatError("archive: expected at least one controller")


class _Counter:
    """Runs episodes and counts them."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator
        self.episodes = self.steps = 0

    def rewards(self, controllers: Sequence[Controller], seeds: Sequence[int]) -> list[list[float]]:
        results = self._evaluator.evaluate(controllers, seeds)
        self.episodes += sum(map(len, results))
        self.steps += sum(episode.steps for row in results for episode in row)
        return [[episode.reward for episode in row] for row in results]
