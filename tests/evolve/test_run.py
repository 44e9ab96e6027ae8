# SPDX-License-Identifier: MIT
"""Runs: what they leave behind, and that neither workers nor interruptions change the result."""

from __future__ import annotations

import contextlib
import csv
import errno
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bitneat import champion as champions
from bitneat import files
from bitneat.champion import EnvironmentSpec
from bitneat.errors import BitneatError
from bitneat.evolve.config import parse
from bitneat.evolve.evaluation import GymnasiumEvaluator
from bitneat.evolve.progress import PlainProgress
from bitneat.evolve.run import Outcome, carry_on
from bitneat.evolve.run_folder import RunFolder, RunSettings, Stage
from bitneat.evolve.search import Search
from bitneat.evolve.setup import episode_limit
from bitneat.runtime import RuntimeController
from bitneat.sim.environment import EpisodeRunner, inspect
from tests.sealed import sealed
from tests.small import small_search

SMALL = small_search(4, 14, "[BitGenome]\nmutate_bias = 1\nmutate_delay = 0.5\n")


class Silent:
    def write(self, text: str) -> int:
        return len(text)

    def flush(self) -> None:
        pass


def settings_for(name: str = "CartPole-v1", text: str = SMALL, seed: int = 5) -> RunSettings:
    return RunSettings(EnvironmentSpec(name), parse(text, "test"), seed)


def evolve(folder: RunFolder, settings: RunSettings, workers: int = 1, *, new: bool = True) -> Outcome:
    if new:
        folder.create(settings)
    info = inspect(settings.environment)
    max_steps = episode_limit(settings.config, settings.environment, info)
    evaluator = GymnasiumEvaluator(settings.environment, info.action, max_steps, workers)
    try:
        return carry_on(folder, settings, info, evaluator, PlainProgress(Silent()))  # type: ignore[arg-type]
    finally:
        evaluator.close()


def test_a_run_folder_holds_configuration_history_checkpoints_champion_and_report(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    settings = settings_for()
    outcome = evolve(folder, settings)
    assert parse((folder.path / "config.ini").read_text(), "config.ini").text == settings.config.text
    rows = list(csv.DictReader((folder.path / "history.csv").open()))
    assert [int(row["generation"]) for row in rows] == [0, 1, 2, 3]
    names = sorted(entry.name for entry in (folder.path / "checkpoints").iterdir())
    assert names == ["generation-000003.json", "generation-000004.json"]
    assert champions.load(folder.champion_pickle) == champions.load(folder.path / "champion.json") == outcome.champion
    report = json.loads((folder.path / "report.json").read_text())
    assert report["held_out"]["first_seed"] == 2**30 + 2**28
    assert not [entry for entry in folder.path.rglob("*") if entry.name.endswith(".tmp")]


def test_the_reported_score_is_what_the_champion_does_on_the_report_seeds(tmp_path: Path) -> None:
    outcome = evolve(RunFolder(tmp_path / "run"), settings_for())
    champion = outcome.champion
    assert champion.environment is not None
    run = EpisodeRunner(
        champion.environment, champion.controller, champion.action, RuntimeController(champion.controller)
    )
    first = champion.provenance["held_out"]["first_seed"]
    rewards = [run(first + i, champion.provenance["max_steps"]).reward for i in range(3)]
    assert sum(rewards) / 3 == champion.provenance["held_out"]["mean"]


@pytest.mark.parametrize("name", ["CartPole-v1", "BipedalWalker-v3"])
def test_the_champion_does_not_depend_on_workers_or_simulator(tmp_path: Path, name: str) -> None:
    contents = set()
    for workers in (1, 2, 3):
        folder = RunFolder(tmp_path / f"run{workers}")
        evolve(folder, settings_for(name), workers)
        contents.add(folder.champion_pickle.read_bytes())
    assert len(contents) == 1


def test_another_seed_gives_another_run(tmp_path: Path) -> None:
    histories = []
    for seed in (1, 2):
        folder = RunFolder(tmp_path / f"run{seed}")
        evolve(folder, settings_for(seed=seed))
        histories.append((folder.path / "history.csv").read_text())
    assert histories[0] != histories[1]


def stop_after(generations: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interrupt the run once that many checkpoints are written."""
    save = RunFolder.save_checkpoint

    def stop(self: RunFolder, search: Search) -> None:
        save(self, search)
        if search.generation == generations:
            raise KeyboardInterrupt

    monkeypatch.setattr(RunFolder, "save_checkpoint", stop)


@pytest.mark.parametrize("generation", [1, 2, 3, 4])
def test_a_run_stopped_after_any_generation_resumes_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, generation: int
) -> None:
    whole, stopped = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "stopped")
    evolve(whole, settings_for())
    with monkeypatch.context() as patch:
        stop_after(generation, patch)
        with pytest.raises(KeyboardInterrupt):
            evolve(stopped, settings_for())
    evolve(stopped, stopped.settings(), new=False)
    for name in ("champion.pkl", "champion.json", "history.csv", "report.json", "checkpoints/generation-000004.json"):
        assert (stopped.path / name).read_bytes() == (whole.path / name).read_bytes(), name


def test_a_finished_run_resumes_to_the_same_champion(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    evolve(folder, settings_for())
    before = folder.champion_pickle.read_bytes()
    evolve(folder, folder.settings(), new=False)
    assert folder.champion_pickle.read_bytes() == before


@pytest.mark.parametrize("whole_folder", [False, True])
@pytest.mark.parametrize("kept", [None, "history.csv", "champion.pkl", "champion.json", "report.json"])
def test_a_run_whose_checkpoints_are_gone_is_not_begun_again(
    tmp_path: Path, kept: str | None, whole_folder: bool
) -> None:
    folder = RunFolder(tmp_path / "run")
    evolve(folder, settings_for())
    checkpoints = folder.path / "checkpoints"
    for path in checkpoints.iterdir():
        path.unlink()
    if whole_folder:
        checkpoints.rmdir()
    for name in ("history.csv", "champion.pkl", "champion.json", "report.json") if kept else ():
        if name != kept:
            (folder.path / name).unlink()
    before = {path: path.read_bytes() for path in folder.path.iterdir() if path.is_file()}
    named = f"{checkpoints}: holds no checkpoint, though {folder.path / (kept or 'history.csv')} says"
    for use in (lambda: evolve(folder, folder.settings(), new=False), folder.generations):
        with pytest.raises(BitneatError, match=re.escape(named)):
            use()
    assert {path: path.read_bytes() for path in folder.path.iterdir() if path.is_file()} == before


@pytest.mark.parametrize("left", ["nothing", "a folder", "a history of no rows"])
def test_a_run_that_was_killed_before_its_first_checkpoint_resumes_from_nothing(tmp_path: Path, left: str) -> None:
    whole, killed = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "killed")
    evolve(whole, settings_for())
    killed.create(settings_for())
    if left != "a folder":
        (killed.path / "checkpoints").rmdir()
    if left == "a history of no rows":
        (killed.path / "history.csv").write_text((whole.path / "history.csv").read_text().splitlines()[0] + "\n")
    evolve(killed, killed.settings(), new=False)
    assert killed.champion_pickle.read_bytes() == whole.champion_pickle.read_bytes()


def test_a_checkpoint_restores_to_itself(tmp_path: Path) -> None:
    settings = settings_for()
    info = inspect(settings.environment)
    search = Search(settings.config, settings.environment, info, 5)
    evaluator = GymnasiumEvaluator(settings.environment, info.action, 60, 1)
    search.advance(evaluator)
    data = json.loads(json.dumps(search.to_data()))
    other = Search(settings.config, settings.environment, info, 99)
    other.restore(data)
    assert json.loads(json.dumps(other.to_data())) == data


def wait_for(condition: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + 120
    while not condition():
        assert process.poll() is None, "the run ended too soon"
        assert time.monotonic() < deadline
        time.sleep(0.005)


def start(*arguments: str) -> subprocess.Popen[bytes]:
    # Where the tests themselves run in the background SIGINT may be ignored, which a child would inherit; a handler it does not.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "bitneat", "evolve", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
    finally:
        signal.signal(signal.SIGINT, before)


def alive(session: int) -> bool:
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue
            if int(fields[3]) == session and fields[0] != "Z":
                return True
    return False


def assert_all_gone(session: int) -> None:
    """Workers and multiprocessing's own tracker notice within moments that their parent has ended."""
    deadline = time.monotonic() + 20
    while alive(session):
        assert time.monotonic() < deadline, "a process outlives its run"
        time.sleep(0.02)


@pytest.fixture
def config_file(tmp_path: Path) -> str:
    path = tmp_path / "small.ini"
    path.write_text(SMALL.replace("max_steps = 60", "max_steps = 120"))
    return str(path)


def test_a_killed_run_resumes_to_the_same_bytes_and_leaves_no_process(tmp_path: Path, config_file: str) -> None:
    common = ["--env", "BipedalWalker-v3", "--config", config_file, "--seed", "7", "--workers", "2"]
    whole = start(*common, "-o", str(tmp_path / "whole"))
    assert whole.wait(120) == 0
    killed = start(*common, "-o", str(tmp_path / "killed"))
    checkpoint = tmp_path / "killed" / "checkpoints" / "generation-000002.json"
    wait_for(checkpoint.exists, killed)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    assert_all_gone(killed.pid)
    resumed = start("--resume", str(tmp_path / "killed"), "--workers", "1")
    assert resumed.wait(120) == 0
    assert (tmp_path / "killed/champion.pkl").read_bytes() == (tmp_path / "whole/champion.pkl").read_bytes()


@pytest.mark.parametrize(
    ("send", "number", "status"), [(os.killpg, signal.SIGINT, 130), (os.kill, signal.SIGTERM, 143)]
)
def test_an_interrupt_stops_cleanly_keeps_the_checkpoint_and_says_how_to_continue(
    tmp_path: Path, config_file: str, send: Callable[[int, int], None], number: int, status: int
) -> None:
    run = tmp_path / "run"
    process = start(
        "--env", "BipedalWalker-v3", "--config", config_file, "--generations", "500", "--workers", "2", "-o", str(run)
    )
    wait_for((run / "checkpoints" / "generation-000001.json").exists, process)
    send(process.pid, number)  # a terminal's goes to all processes
    _, errors = process.communicate(timeout=60)
    assert process.returncode == status
    assert b"Traceback" not in errors
    assert errors.splitlines()[-1] == f"bitneat: stopped; continue with: bitneat evolve --resume {run}".encode()
    assert errors.count(b"bitneat:") == 1
    assert list((run / "checkpoints").glob("generation-*.json"))
    assert_all_gone(process.pid)


def test_a_full_disk_at_a_checkpoint_keeps_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = RunFolder(tmp_path / "run")
    real = os.fsync

    def full(descriptor: int) -> None:
        if "generation-000003" in str(Path(f"/proc/self/fd/{descriptor}").readlink()):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(files.os, "fsync", full)
        with pytest.raises(BitneatError, match=r"generation-000003\.json: cannot write: No space left"):
            evolve(folder, settings_for())
    assert sorted(entry.name for entry in (folder.path / "checkpoints").iterdir()) == [
        "generation-000001.json",
        "generation-000002.json",
    ]
    whole = RunFolder(tmp_path / "whole")
    evolve(whole, settings_for())
    evolve(folder, folder.settings(), new=False)
    assert folder.champion_pickle.read_bytes() == whole.champion_pickle.read_bytes()


def test_damaged_and_foreign_run_folders_are_refused(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    with pytest.raises(BitneatError, match=r"holds no run: run\.json is missing"):
        folder.settings()
    evolve(folder, settings_for())
    checkpoint = folder.path / "checkpoints" / "generation-000004.json"
    (folder.path / "checkpoints" / "generation-000003.json").unlink()  # which would stand in for it
    good = checkpoint.read_text()
    for bad, message in (
        (good[: len(good) // 2], "damaged: not JSON"),
        ("[]", "damaged: expected 'format'"),
        (good.replace('"generation":4', '"generation":5', 1), "another SHA-256 than was written"),
        (good[: good.rindex(',"sha256"')] + "}", "does not end with its SHA-256"),
        (sealed(json.loads(good.replace('"version":2', '"version":3'))), "version 3: this bitneat reads 2"),
        (sealed(json.loads(good.replace('"next_node"', '"nxt_node"'))), "damaged: KeyError"),
        (sealed(json.loads(good.replace('"population":[[', '"population":[[7,'))), "damaged"),
    ):
        checkpoint.write_text(bad)
        with pytest.raises(BitneatError, match=message) as caught:
            evolve(folder, folder.settings(), new=False)
        assert "generation-000004.json" in str(caught.value)
    (folder.path / "run.json").write_text('{"format": "bitneat-run", "version": 1}')
    with pytest.raises(BitneatError, match=r"run\.json: damaged"):
        folder.settings()


def test_a_second_run_in_the_same_folder_is_refused_with_a_hint(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    folder.create(settings_for())
    with pytest.raises(BitneatError, match="holds a run already; continue it with --resume"):
        folder.create(settings_for())


def test_duplicates_are_evaluated_once_and_rank_last(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = settings_for(text=SMALL.replace("mutate_bias = 1", "initial_links = 1\nmutate_gain = 0"))
    info = inspect(settings.environment)
    search = Search(settings.config, settings.environment, info, 1)
    genomes = sorted(search.population.population.items())
    evaluator = GymnasiumEvaluator(settings.environment, info.action, 60, 1)
    stages: list[list[str]] = []
    evaluate = evaluator.evaluate

    def recorded(controllers: Any, *rest: Any) -> Any:
        stages.append([controller.sha256 for controller in controllers])
        return evaluate(controllers, *rest)

    monkeypatch.setattr(evaluator, "evaluate", recorded)
    row = search.advance(evaluator)
    policies = [search.kind.lower(genome)[0].sha256 for _, genome in genomes]
    originals = [
        genome for (_, genome), sha in zip(genomes, policies, strict=True) if policies.index(sha) == genome.key - 1
    ]
    copies = [genome for _, genome in genomes if genome not in originals]
    assert row.duplicates == len(copies) >= 2
    assert sorted(stages[0]) == sorted(set(policies))
    ranks = sorted(genome.fitness or 0.0 for genome in originals)
    assert ranks == pytest.approx([rank / (len(originals) - 1) for rank in range(len(originals))])
    assert [genome.fitness for genome in copies] == [0.0] * len(copies)  # with the last of the others


def changed(data: Any, path: tuple[Any, ...], value: object) -> Any:
    """The data with another value at a path of keys."""
    copy = json.loads(json.dumps(data))
    inner = copy
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return copy


@pytest.fixture(scope="module")
def first_generation(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = RunFolder(tmp_path_factory.mktemp("hostile") / "run")
    evolve(folder, settings_for(text=SMALL.replace("generations = 4", "generations = 1")))
    return folder


@pytest.mark.parametrize("value", [-1, 1 << 70, float("nan"), float("inf"), "text", None, [], {}, True, [[1]]])
@pytest.mark.parametrize(
    "path",
    [
        ("generation",), ("population",), ("previous_keys",), ("species",), ("threshold",), ("next_species",),
        ("next_genome",), ("next_node",), ("innovations",), ("streams",), ("candidates",), ("history",),
        ("population", 0), ("population", 0, 0), ("population", 0, 2), ("population", 0, 2, 0, 0),
        ("population", 0, 2, 0, 1), ("population", 0, 2, 0, 2), ("population", 0, 3), ("population", 0, 3, 0, 0),
        ("population", 0, 3, 0, 2), ("candidates", 0, "rewards"), ("candidates", 0, "generation"),
        ("candidates", 0, "controller"), ("history", 0), ("history", 0, 1), ("streams", "neat", 1), ("species", 0, 3),
    ],
)  # fmt: skip
def test_a_hostile_checkpoint_is_one_line_or_does_no_harm(
    first_generation: RunFolder, tmp_path: Path, path: tuple[Any, ...], value: object
) -> None:
    name = "generation-000001.json"
    data = json.loads((first_generation.path / "checkpoints" / name).read_text())
    folder = RunFolder(tmp_path)
    (tmp_path / "checkpoints").mkdir()
    (tmp_path / "checkpoints" / name).write_text(sealed(changed(data, ("search", *path), value)))
    settings = settings_for()
    search = Search(settings.config, settings.environment, inspect(settings.environment), 5)
    try:
        folder.restore(search)
    except BitneatError as error:
        assert str(error).startswith(f"{tmp_path / 'checkpoints' / name}: damaged: ")
        assert "\n" not in str(error)
    else:  # then the search can go on
        search.advance(GymnasiumEvaluator(settings.environment, search.info.action, 60, 1))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("seed",), -1), (("seed",), True), (("seed",), "1"), (("seconds",), -1), (("seconds",), float("nan")),
        (("seconds",), True), (("seconds",), "1"), (("earlier",), 1), (("earlier",), [{"generations": float("inf")}]),
        (("environment",), None), (("environment", "kwargs"), 1), (("environment", "imports"), "os"),
        (("trigonometry",), 7), (("trigonometry",), "0123"), (("trigonometry",), "0123456789ABCDEF\n"),
        (("identity",), 7), (("identity",), "0123"), (("identity",), None),
    ],
)  # fmt: skip
def test_a_hostile_run_file_is_one_line(
    first_generation: RunFolder, tmp_path: Path, path: tuple[Any, ...], value: object
) -> None:
    data = json.loads((first_generation.path / "run.json").read_text())
    (tmp_path / "config.ini").write_text((first_generation.path / "config.ini").read_text())
    (tmp_path / "run.json").write_text(sealed(changed(data, path, value)))
    with pytest.raises(BitneatError, match=r"run\.json: damaged: ") as caught:
        RunFolder(tmp_path).settings()
    assert "\n" not in str(caught.value)


def test_checkpoints_of_another_run_are_not_gone_on_from(tmp_path: Path) -> None:
    ours, theirs = RunFolder(tmp_path / "ours"), RunFolder(tmp_path / "theirs")
    evolve(ours, settings_for(seed=5))
    evolve(theirs, settings_for(seed=6))
    before = ours.champion_pickle.read_bytes()
    newest = ours.path / "checkpoints" / "generation-000004.json"
    own = newest.read_bytes()
    newest.write_bytes((theirs.path / "checkpoints" / newest.name).read_bytes())
    again = RunFolder(ours.path)
    with pytest.raises(
        BitneatError, match=r"generation-000004\.json: is of another run than [^\n]*run\.json"
    ) as caught:
        evolve(again, again.settings(), new=False)
    assert "\n" not in str(caught.value)
    assert ours.champion_pickle.read_bytes() == before
    newest.write_bytes(own)
    evolve(again, again.settings(), new=False)
    assert ours.champion_pickle.read_bytes() == before


def test_a_run_keeps_its_checkpoints_under_another_configuration_or_length(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    evolve(folder, settings_for())
    settings = folder.settings()
    longer = replace(settings, config=settings.config.with_values("evolve", generations=5, finalists=3))
    folder.save_settings(replace(longer, earlier=(Stage(4, settings.config.text),)))
    folder = RunFolder(folder.path)
    evolve(folder, folder.settings(), new=False)
    assert folder.generations() == 5


def of_before(folder: Path, *, version: int) -> None:
    """Make of a run one as an earlier bitneat left it: without identity, and in version 1 without hashes and configuration."""
    for path in (folder / "run.json", *(folder / "checkpoints").iterdir()):
        data = json.loads(path.read_text())
        dropped = {"identity", "run"} if version == 2 else {"identity", "run", "config", "sha256"}
        data = {**{key: value for key, value in data.items() if key not in dropped}, "version": version}
        path.write_text(sealed(data) if version == 2 else json.dumps(data))


@pytest.mark.parametrize("version", [1, 2])
def test_a_run_of_before_it_had_an_identity_goes_on_to_the_same_bytes(tmp_path: Path, version: int) -> None:
    whole, old = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "old")
    evolve(whole, settings_for())
    evolve(old, settings_for(text=SMALL.replace("generations = 4", "generations = 2")))
    of_before(old.path, version=version)
    old = RunFolder(old.path)
    settings = old.settings()
    old.save_settings(replace(settings, config=settings.config.with_values("evolve", generations=4)))
    old = RunFolder(old.path)
    evolve(old, old.settings(), new=False)
    for name in ("champion.pkl", "champion.json", "history.csv", "report.json"):
        assert (old.path / name).read_bytes() == (whole.path / name).read_bytes(), name


@pytest.mark.parametrize("version", [1, 2])
def test_settings_that_are_cut_short_while_they_are_saved_are_the_old_or_the_new(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, version: int
) -> None:
    old = settings_for()
    new = replace(old, config=old.config.with_values("evolve", generations=9))
    found = []
    for calls in range(10):
        folder = RunFolder(tmp_path / f"{calls}")
        folder.create(old)
        of_before(folder.path, version=version)
        left = iter(range(calls))

        def counted(real: Callable[..., Any], left: Any = left) -> Callable[..., Any]:
            def call(*arguments: Any, **options: Any) -> Any:
                if next(left, None) is None:
                    raise KeyboardInterrupt
                return real(*arguments, **options)

            return call

        with monkeypatch.context() as patch, contextlib.suppress(KeyboardInterrupt):
            patch.setattr(Path, "unlink", counted(Path.unlink))
            patch.setattr(Path, "replace", counted(Path.replace))
            RunFolder(folder.path).save_settings(new)
        found.append(RunFolder(folder.path).settings().config.text)
    assert found == sorted(found, key=[old.config.text, new.config.text].index)
    assert {found[0], found[-1]} == {old.config.text, new.config.text}
