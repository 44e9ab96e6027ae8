# SPDX-License-Identifier: MIT
"""A run's folder: what was asked for, where the search stands, and what it has come to.

Every file is written whole or not at all. What a resumed run needs is in ``run.json`` (what was asked for) and in the last
checkpoint (where the search stood); both are plain JSON, so that a run folder from a stranger can execute nothing, and carry a hash
of themselves, so that a damaged one is known. If the last checkpoint is damaged, the one before is taken.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from bitneat.champion import AnyChampion, EnvironmentSpec, environment_from_data, save_json, save_pickle
from bitneat.controller import Controller
from bitneat.errors import BitneatError
from bitneat.evolve.config import MAX_CONFIG_BYTES, Config, parse
from bitneat.evolve.randomness import MAX_SEED
from bitneat.evolve.recheck import SimulatorsDifferError
from bitneat.evolve.search import Generation, Search
from bitneat.files import (
    make_folder,
    read_capped,
    refuse_links,
    remove_leftovers,
    sole_user,
    sync_folder,
    write_atomic,
)
from bitneat.folders import EVOLVE, begun
from bitneat.state import DamagedError, read_state, seal
from bitneat.version import __version__

FORMAT = "bitneat-run"
CHECKPOINT_FORMAT = "bitneat-checkpoint"
VERSION = 2
"""Of ``run.json`` and of checkpoints. Those of version 1, which have no hash, are read, too."""
CHECKPOINTS_KEPT = 2
MAX_RUN_BYTES = 1 << 26
MAX_CHECKPOINT_BYTES = 1 << 28

_TRIGONOMETRY = re.compile(r"[0-9a-f]{16}")
_IDENTITY = re.compile(r"[0-9a-f]{64}")
_CHECKPOINT_NAME = re.compile(r"generation-(\d{6,})\.json")


@dataclass(frozen=True)
class Stage:
    """A configuration that a run had before it was given another."""

    generations: int
    """Generations completed when the next configuration took over."""
    config: str

    def to_data(self) -> dict[str, Any]:
        """As plain data."""
        return {"generations": self.generations, "config": self.config}


@dataclass(frozen=True)
class RunSettings:
    """What was asked for: everything that decides the result, and the time limit, which may cut it short."""

    environment: EnvironmentSpec
    config: Config
    seed: int
    seconds: float | None = None
    earlier: tuple[Stage, ...] = ()
    trigonometry: str | None = None
    """Hash of the C library's functions that walkers depend on, where the run began; see `bitneat.sim.walker.trigonometry`."""
    start: tuple[Controller, ...] = ()
    """What the first population is made of; see `bitneat.evolve.starting`."""

    @property
    def begun_at(self) -> int:
        """Generations completed when the configuration took over: no checkpoint of before can go on under it."""
        return self.earlier[-1].generations if self.earlier else 0

    def identity(self) -> str:
        """A hash of what a run begins with, by which its checkpoints are known for its own."""
        begins = {
            "environment": self.environment.to_data(),
            "config": self.earlier[0].config if self.earlier else self.config.text,
            "seed": f"{self.seed:x}",
            "start": [controller.sha256 for controller in self.start],
        }
        return hashlib.sha256(json.dumps(begins, sort_keys=True).encode()).hexdigest()

    def to_data(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "environment": self.environment.to_data(),
            "config": self.config.text,
            "seed": self.seed,
            "seconds": self.seconds,
            "earlier": [stage.to_data() for stage in self.earlier],
            "trigonometry": self.trigonometry,
            **({"start": [controller.to_data() for controller in self.start]} if self.start else {}),
        }


class RunFolder:
    """The files of a run.

    Args:
        path: of the folder.
        warn: told, once, of a damaged checkpoint that another stands in for.
    """

    def __init__(self, path: Path, warn: Callable[[str], None] = warnings.warn) -> None:
        self.path = path
        self._warn = warn
        self._told: set[str] = set()
        self._held = False
        self._known: str | None = None

    @property
    def champion_pickle(self) -> Path:
        """``champion.pkl``."""
        return self.path / "champion.pkl"

    @property
    def _settings_file(self) -> Path:
        return self.path / "run.json"

    @property
    def _config_file(self) -> Path:
        return self.path / "config.ini"

    def create(self, settings: RunSettings) -> None:
        """Make the folder and write what was asked for.

        Raises:
            BitneatError: as of `begin`.
        """
        with self.begin(settings):
            pass

    @contextlib.contextmanager
    def begin(self, settings: RunSettings) -> Iterator[None]:
        """Make the folder, write what was asked for, and be the only process at work there meanwhile.

        What fails before the first checkpoint would fail again, and its run would be in the way of another try: it goes. Where only
        the simulators differ it stays, since it can go on with the other one.

        Raises:
            BitneatError: if there is a run already, or a file that this one would write or go on from; or the folder cannot be
                written, or another process is at work there.
        """
        with begun(self.path, EVOLVE) as made, self._holding():
            try:
                make_folder(self.path / "checkpoints")
                self._refuse_links()
                self.save_settings(settings)
                yield
            except SimulatorsDifferError:
                raise
            except Exception:
                if not self.is_begun:
                    self._discard(folder_too=made)
                raise

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Be the only process at work there; within it and within `begin` that is so already.

        Raises:
            BitneatError: if another process is.
        """
        if self._held:
            yield
            return
        with sole_user(self.path), self._holding():
            yield

    @contextlib.contextmanager
    def _holding(self) -> Iterator[None]:
        self._held = True
        try:
            yield
        finally:
            self._held = False

    def _refuse_links(self) -> None:
        refuse_links(self.path)
        if (self.path / "checkpoints").is_dir():
            refuse_links(self.path / "checkpoints")

    def _discard(self, *, folder_too: bool) -> None:
        """Take away a run that no generation was completed of; nothing of that name was there before it."""
        with contextlib.suppress(OSError):  # whatever else is in there is not ours, and a disk may be read-only by now
            for name in (
                "config.ini",
                "history.csv",
                "run.json",
            ):  # without the others it is a run, without the last one it is none
                (self.path / name).unlink(missing_ok=True)
            (self.path / "checkpoints").rmdir()
            if folder_too:
                self.path.rmdir()

    def save_settings(self, settings: RunSettings) -> None:
        """Write ``run.json``, which makes the folder a run, and ``config.ini``, which is for people.

        ``config.ini`` is away while ``run.json`` changes: the two never disagree, wherever this is cut short. The identity is that
        of the run's first settings; it is kept, since a later bitneat may write the same configuration otherwise.
        """
        if self._settings_file.exists():
            identity = self._identity()
            self._keep_config()
        else:
            identity = self._known = settings.identity()
        if self._config_file.exists():
            self._config_file.unlink()
            sync_folder(self.path)
        content = {**settings.to_data(), **({"identity": identity} if identity else {})}
        write_atomic(self._settings_file, seal(content, indent=2))
        write_atomic(self._config_file, settings.config.text.encode())

    def _keep_config(self) -> None:
        """Put the configuration of a run of version 1, which ``config.ini`` alone has, into its ``run.json``."""
        data = read_state(self._settings_file, FORMAT, VERSION, MAX_RUN_BYTES)
        if data["version"] == 1:
            content = {**data, "version": VERSION, "config": _text(self._config_file)}
            write_atomic(self._settings_file, seal(content, indent=2))

    def _identity(self) -> str:
        """As of `RunSettings.identity`; empty for a run of before it was recorded, or where there is none."""
        if self._known is None:
            found = None
            if self._settings_file.exists():
                found = read_state(self._settings_file, FORMAT, VERSION, MAX_RUN_BYTES).get("identity")
            self._known = found if isinstance(found, str) else ""
        return self._known

    def mend(self, settings: RunSettings, search: Search) -> None:
        """Make good what a process that died after a checkpoint has left undone: files to write, and files to take away."""
        make_folder(self.path / "checkpoints")
        remove_leftovers(self.path / "checkpoints")
        self._drop_old(search.generation)
        self.save_history(search)
        if not self._config_file.exists():
            write_atomic(self._config_file, settings.config.text.encode())

    def settings(self) -> RunSettings:
        """What was asked for.

        Raises:
            BitneatError: if the folder holds no run, or a damaged one, or ``config.ini`` was edited.
        """
        path = self._settings_file
        if not path.exists():
            raise BitneatError(f"--resume {self.path}: holds no run: run.json is missing")
        self._refuse_links()
        data = read_state(path, FORMAT, VERSION, MAX_RUN_BYTES)
        config = self._config(data)
        try:
            spec = environment_from_data(data["environment"])
            seed, seconds = data["seed"], data["seconds"]
            trigonometry = data.get("trigonometry")  # runs of before it was recorded lack the key
            start = tuple(Controller.from_data(entry) for entry in data.get("start", ()))
            earlier = tuple(Stage(_count(stage["generations"]), str(stage["config"])) for stage in data["earlier"])
            if type(seed) is not int or not 0 <= seed < MAX_SEED:
                raise BitneatError("seed: expected an integer from 0")
            if seconds is not None and not (type(seconds) in (int, float) and 0 < seconds < math.inf):
                raise BitneatError("seconds: expected a number above 0, or null")
            if trigonometry is not None and not (
                isinstance(trigonometry, str) and _TRIGONOMETRY.fullmatch(trigonometry)
            ):
                raise BitneatError("trigonometry: expected 16 hexadecimal digits, or null")
            identity = data.get("identity", "")  # as of the same
            if identity != "" and not (isinstance(identity, str) and _IDENTITY.fullmatch(identity)):
                raise BitneatError("identity: expected 64 hexadecimal digits")
            self._known = identity
        except Exception as error:  # the file may be anyone's
            raise BitneatError(f"{path}: damaged: {_reason(error)}") from None
        return RunSettings(spec, config, seed, seconds, earlier, trigonometry, start)

    def _config(self, data: Mapping[str, Any]) -> Config:
        """The configuration in ``run.json``; ``config.ini`` must say the same, if it is there.

        Runs of version 1 have it in ``config.ini`` alone.
        """
        path = self._config_file
        if data["version"] == 1:
            return parse(_text(path), str(path))
        if not isinstance(data.get("config"), str):
            raise BitneatError(f"{self._settings_file}: damaged: config: expected text")
        config = parse(data["config"], f"{self._settings_file}: config")
        if path.exists() and _text(path) != data["config"]:
            raise BitneatError(
                f"{path}: damaged or edited: not what the run has; delete it to go on as before,"
                " or move it elsewhere and give it with --config"
            )
        return config

    def generations(self, begun_at: int = 0) -> int:
        """Generations completed, according to the last checkpoint that is whole.

        Args:
            begun_at: as of `RunSettings`.

        Raises:
            BitneatError: if no checkpoint can be used.
        """
        found = self._last(begun_at)
        return 0 if found is None else found[0]

    @property
    def is_begun(self) -> bool:
        """Whether there is a checkpoint, whole or not."""
        return bool(self._checkpoints())

    def save_checkpoint(self, search: Search) -> None:
        """Write the checkpoint of the generations completed, then drop all but the one before it.

        Raises:
            BitneatError: if it cannot be written, or is larger than what would be read.
        """
        head = {"format": CHECKPOINT_FORMAT, "version": VERSION, "bitneat": __version__}
        identity = self._identity()
        state = {**head, **({"run": identity} if identity else {}), "search": search.to_data()}
        path = self.path / "checkpoints" / f"generation-{search.generation:06d}.json"
        content = seal(state, allow_nan=True)
        if len(content) > MAX_CHECKPOINT_BYTES:
            raise BitneatError(f"{path}: larger than {MAX_CHECKPOINT_BYTES} bytes; take a smaller population")
        write_atomic(path, content)
        self._drop_old(search.generation)

    def restore(self, search: Search, begun_at: int = 0) -> None:
        """Bring the search to the last checkpoint that is whole; without one it starts at the beginning.

        Raises:
            BitneatError: if no checkpoint can be used, or one is not this run's or from a newer bitneat; or there is none, though
                a generation was completed.
        """
        found = self._last(begun_at)
        if found is None:
            return
        generation, path, data = found
        try:
            search.restore(data["search"])
        except Exception as error:  # the file may be anyone's
            raise BitneatError(f"{path}: damaged: {_reason(error)}") from None
        if search.generation != generation:
            raise BitneatError(f"{path}: damaged: holds generation {search.generation}")

    def _drop_old(self, generation: int) -> None:
        """Delete checkpoints that neither this generation's nor the one that would stand in for it is."""
        for number, path in self._checkpoints():
            if number <= generation - CHECKPOINTS_KEPT:
                path.unlink(missing_ok=True)

    def _last(self, begun_at: int) -> tuple[int, Path, Mapping[str, Any]] | None:
        """Generation, path and content of the last checkpoint that is whole; of damaged ones after it the user is told.

        Raises:
            BitneatError: as of `restore`.
        """
        damage: DamagedError | None = None
        for generation, path in reversed(self._checkpoints()):
            if generation < begun_at:
                break
            try:
                data = read_state(path, CHECKPOINT_FORMAT, VERSION, MAX_CHECKPOINT_BYTES)
            except DamagedError as error:
                damage = damage or error
                continue
            self._refuse_foreign(path, data)
            if damage is not None and str(damage) not in self._told:
                self._told.add(str(damage))
                self._warn(f"{damage}; going on from {path.name}")
            return generation, path, data
        if damage is not None:
            raise damage
        if begun_at:
            raise BitneatError(
                f"{self.path / 'checkpoints'}: holds no checkpoint of generation {begun_at} or later,"
                " as a run needs whose configuration was changed there"
            )
        self._refuse_lost()
        return None

    def _refuse_lost(self) -> None:
        """Refuse to begin again where something says that a generation was completed: it would be written over.

        A run that was killed before its first checkpoint has a history of no rows, and none of the other files.
        """
        history = self.path / "history.csv"
        left = [self.path / name for name in ("champion.pkl", "champion.json", "report.json")]
        if history.exists() and len(read_capped(history, MAX_CHECKPOINT_BYTES, regular=True).splitlines()) > 1:
            left.insert(0, history)
        for path in left:
            if path.exists():
                raise BitneatError(
                    f"{self.path / 'checkpoints'}: holds no checkpoint, though {path} says that a generation was completed;"
                    " put the last one back, or begin a new run with another -o"
                )

    def _refuse_foreign(self, path: Path, data: Mapping[str, Any]) -> None:
        """Checkpoints, and runs, of before there was an identity lack it, and are taken as they are."""
        ours, theirs = self._identity(), data.get("run")
        if ours and theirs is not None and theirs != ours:
            raise BitneatError(
                f"{path}: is of another run than {self._settings_file}, which began with other settings; expected its own"
                " checkpoint: put it back, or remove this one"
            )

    def save_history(self, search: Search) -> None:
        """Write ``history.csv``, a row a generation."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([field.name for field in fields(Generation)])
        writer.writerows(vars(row).values() for row in search.history)
        write_atomic(self.path / "history.csv", out.getvalue().encode())

    def save_champion(self, champion: AnyChampion) -> None:
        """Write ``champion.pkl`` and ``champion.json``."""
        save_json(champion, self.path / "champion.json")
        save_pickle(champion, self.champion_pickle)

    def _checkpoints(self) -> list[tuple[int, Path]]:
        folder = self.path / "checkpoints"
        if not folder.is_dir():
            return []
        found = [(match, entry) for entry in folder.iterdir() if (match := _CHECKPOINT_NAME.fullmatch(entry.name))]
        return sorted((int(match[1]), entry) for match, entry in found)


def _count(value: Any) -> int:
    if type(value) is not int or not 0 <= value < 1 << 53:
        raise BitneatError("earlier: expected a number of generations")
    return value


def _reason(error: Exception) -> str:
    text = " ".join(str(error).split())[:200]
    return text if isinstance(error, BitneatError) else f"{type(error).__name__}: {text}"


def _text(path: Path) -> str:
    return read_capped(path, MAX_CONFIG_BYTES, regular=True).decode("utf-8", "replace")
