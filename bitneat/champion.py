# SPDX-License-Identifier: MIT
"""The champion file: a controller, the environment it was evolved in, and where it came from.

`champion.pkl` is a pickle of plain data only and `champion.json` holds the same content; `docs/file-formats.md` lays them out.
A pickle can run code when Python loads it, so Python never does: `bitneat.unpickle` reads it.
"""

from __future__ import annotations

import codecs
import hashlib
import io
import json
import math
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bitneat.controller import Action, Controller, action_from_data
from bitneat.errors import BitneatError
from bitneat.files import read_capped, write_atomic
from bitneat.network import FloatNetwork, network_from_data
from bitneat.unpickle import MAX_DEPTH, UnpickleError, read

FORMAT = "bitneat-champion"
FLOAT_FORMAT = "bitneat-float-champion"
VERSION = 1
MAX_FILE_BYTES = 16 * 1024 * 1024
MAX_VALUES = 1_000_000
MAX_INTEGER_BITS = 1024
CHECKSUM = "content_sha256"
"""Key of a file's hash of all the others, by which a damaged file is known; files of before it, and others', lack it."""


class ChampionError(BitneatError):
    """A champion file cannot be read."""


@dataclass(frozen=True)
class EnvironmentSpec:
    """Which Gymnasium environment: its id, keyword arguments, and modules to import first because they register it."""

    id: str
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    imports: tuple[str, ...] = ()

    def to_data(self) -> dict[str, Any]:
        """Plain data that `environment_from_data` reads back."""
        return {"id": self.id, "kwargs": dict(self.kwargs), "imports": list(self.imports)}


@dataclass(frozen=True)
class Champion:
    """A controller with its context.

    ``environment`` is None for a controller that was imported without one. ``provenance`` is plain data: configuration text,
    seeds, generation, package versions, held-out score with its seeds; nothing that depends on the clock or the machine.
    """

    controller: Controller
    action: Action
    environment: EnvironmentSpec | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.action.num_outputs != len(self.controller.outputs):
            raise ChampionError(
                f"action: needs {self.action.num_outputs} outputs, the controller has {len(self.controller.outputs)}"
            )

    def to_data(self) -> dict[str, Any]:
        """The whole champion as plain data."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "controller": self.controller.to_data(),
            "environment": None if self.environment is None else self.environment.to_data(),
            "action": self.action.to_data(),
            "provenance": dict(self.provenance),
        }


@dataclass(frozen=True)
class FloatChampion:
    """A float network with its context, as of `Champion`; there is no C for it."""

    network: FloatNetwork
    action: Action
    environment: EnvironmentSpec | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.action.num_outputs != len(self.network.outputs):
            raise ChampionError(
                f"action: needs {self.action.num_outputs} outputs, the network has {len(self.network.outputs)}"
            )

    def to_data(self) -> dict[str, Any]:
        """The whole champion as plain data."""
        return {
            "format": FLOAT_FORMAT,
            "version": VERSION,
            "network": self.network.to_data(),
            "environment": None if self.environment is None else self.environment.to_data(),
            "action": self.action.to_data(),
            "provenance": dict(self.provenance),
        }


AnyChampion = Champion | FloatChampion


def any_from_data(data: object) -> AnyChampion:
    """Read a champion of either kind from plain data.

    Raises:
        BitneatError: naming the field that is missing, unknown or wrong.
    """
    if not isinstance(data, Mapping) or data.get("format") not in (FORMAT, FLOAT_FORMAT):
        raise ChampionError(f"not a champion: expected a mapping with 'format': {FORMAT!r}")
    content = "controller" if data["format"] == FORMAT else "network"
    version = data.get("version")
    if type(version) is int and version > VERSION:
        raise ChampionError(f"version: {version} was written by a newer bitneat, this one reads {VERSION}")
    if type(version) is not int or version != VERSION:
        raise ChampionError(f"version: expected {VERSION}, got {version!r:.40}")
    expected = {"format", "version", content, "environment", "action", "provenance"}
    for key in sorted(expected - set(data)):
        raise ChampionError(f"missing key {key!r}")
    for key in data:
        if key not in expected and key != CHECKSUM:
            raise ChampionError(f"unknown key {key!r:.60}")
    if CHECKSUM in data and data[CHECKSUM] != checksum({key: data[key] for key in expected}):
        raise ChampionError(
            f"damaged: its content has another SHA-256 than {CHECKSUM} says; if you edited it, remove that key"
        )
    if not isinstance(data["provenance"], Mapping):
        raise ChampionError("provenance: expected a mapping")
    environment = None if data["environment"] is None else environment_from_data(data["environment"])
    action, provenance = action_from_data(data["action"]), dict(data["provenance"])
    if content == "network":
        return FloatChampion(network_from_data(data["network"]), action, environment, provenance)
    return Champion(Controller.from_data(data["controller"]), action, environment, provenance)


def from_data(data: object) -> Champion:
    """Read a champion from plain data.

    Raises:
        BitneatError: naming the field that is missing, unknown or wrong; or if it holds a float network.
    """
    champion = any_from_data(data)
    if isinstance(champion, FloatChampion):
        raise ChampionError(
            "holds a float network, expected an integer controller; make it one with `bitneat quantize FILE --to ternary`"
        )
    return champion


def environment_from_data(data: object) -> EnvironmentSpec:
    """Read what `EnvironmentSpec.to_data` wrote.

    Raises:
        BitneatError: if a field is missing, unknown or of the wrong type.
    """
    if not isinstance(data, Mapping) or set(data) != {"id", "kwargs", "imports"}:
        raise ChampionError("environment: expected a mapping with the keys id, kwargs, imports")
    imports = data["imports"]
    if not isinstance(data["id"], str):
        raise ChampionError("environment.id: expected a string")
    if not isinstance(data["kwargs"], Mapping) or not all(isinstance(key, str) for key in data["kwargs"]):
        raise ChampionError("environment.kwargs: expected a mapping with strings as keys")
    if not isinstance(imports, (list, tuple)) or not all(isinstance(name, str) for name in imports):
        raise ChampionError("environment.imports: expected a list of strings")
    return EnvironmentSpec(data["id"], dict(data["kwargs"]), tuple(imports))


def load(path: str | Path) -> Champion:
    """Read ``champion.pkl`` or ``champion.json``, or a pipe; which of them it is, the content tells.

    Raises:
        BitneatError: in one line that names the file and what is wrong. Nothing in the file is ever executed.
    """
    return _load(path, regular=False)


def load_found(path: Path) -> Champion:
    """As `load`, of a file that a folder holds and nobody named: a pipe there is refused, which would be waited for."""
    return _load(path, regular=True)


def _load(path: str | Path, *, regular: bool) -> Champion:
    content = read_capped(path, MAX_FILE_BYTES, regular=regular)
    try:
        return loads(content)
    except BitneatError as error:
        raise ChampionError(f"{path}: {error}") from None


def load_any(path: str | Path) -> AnyChampion:
    """As `load`, float networks too."""
    content = read_capped(path, MAX_FILE_BYTES)
    try:
        return loads_any(content)
    except BitneatError as error:
        raise ChampionError(f"{path}: {error}") from None


def loads(content: bytes) -> Champion:
    """Read a champion from the bytes of either form.

    Raises:
        BitneatError: if it is truncated, hostile, foreign or of a later version, or holds a float network.
    """
    return from_data(_plain(content))


def loads_any(content: bytes) -> AnyChampion:
    """As `loads`, float networks too."""
    return any_from_data(_plain(content))


def _plain(content: bytes) -> Any:
    """The plain data in a file's bytes, whichever of the two forms it has."""
    if len(content) > MAX_FILE_BYTES:
        raise ChampionError(f"not a champion: larger than {MAX_FILE_BYTES} bytes")
    if not content:
        raise ChampionError("not a champion: the file is empty")
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise ChampionError("not a champion: text in UTF-16, expected JSON in UTF-8")
    # No pickle begins like an object or a list of JSON, nor like the mark that some editors put before a text.
    text = content.removeprefix(codecs.BOM_UTF8)
    is_json = len(text) < len(content) or text.lstrip()[:1] in (b"{", b"[")
    return _plain_json(text) if is_json else plain_pickle(content)


def dumps(champion: AnyChampion) -> str:
    """The champion as JSON text, ended by a newline."""
    return json.dumps(_with_checksum(champion), indent=1, ensure_ascii=True, allow_nan=False) + "\n"


def dump_pickle(champion: AnyChampion) -> bytes:
    """The champion as a pickle: the same bytes for equal champions, however their parts are shared in memory."""
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer, protocol=4)
    # Without its memo a pickle does not tell equal strings from identical ones.
    pickler.fast = True
    pickler.dump(_with_checksum(champion))
    return buffer.getvalue()


def checksum(data: Mapping[str, Any]) -> str:
    """SHA-256 of a champion's plain data, as compact JSON in ASCII with sorted keys: the same for both forms of a file."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _with_checksum(champion: AnyChampion) -> dict[str, Any]:
    data: dict[str, Any] = plain_data(champion.to_data())
    return {**data, CHECKSUM: checksum(data)}


def save_pickle(champion: AnyChampion, path: str | Path) -> None:
    """Write ``champion.pkl``, atomically."""
    write_atomic(path, dump_pickle(champion))


def save_json(champion: AnyChampion, path: str | Path) -> None:
    """Write ``champion.json``, atomically."""
    write_atomic(path, dumps(champion).encode("ascii"))


def plain_pickle(content: bytes) -> Any:
    """The plain data in a pickle, its tuples as lists.

    Raises:
        BitneatError: if it holds anything but dictionaries, lists, tuples, strings, numbers, booleans and None, or is damaged.
    """
    try:
        data = read(content)
    except UnpickleError as error:
        reason = str(error)
        raise ChampionError(reason if reason.startswith("refused") else f"not a champion: {reason}") from None
    return plain_data(data)


def _plain_json(content: bytes) -> Any:
    def refuse(text: str) -> Any:
        raise ChampionError(f"not a champion: {text} is no JSON number")

    try:
        data = json.loads(content.decode("utf-8"), parse_constant=refuse)
    except ChampionError:
        raise
    except (ValueError, RecursionError) as error:
        raise ChampionError(f"not a champion: damaged or truncated JSON ({error!s:.80})") from None
    return plain_data(data)


def plain_data(data: Any) -> Any:
    """A copy of the data with tuples as lists, if a champion file can hold it.

    Raises:
        BitneatError: if it is not plain, too deep, or, shared parts counted each time, too large.
    """
    return _Checker().copy(data, 0)


class _Checker:
    def __init__(self) -> None:
        self.values = 0

    def copy(self, value: Any, depth: int) -> Any:
        self.values += 1
        if self.values > MAX_VALUES or depth > MAX_DEPTH:
            raise ChampionError(f"refused: more than {MAX_VALUES} values or {MAX_DEPTH} levels")
        if isinstance(value, dict):
            if not all(type(key) is str for key in value):
                raise ChampionError("refused: a key is not a string")
            return {self.copy(key, depth): self.copy(item, depth + 1) for key, item in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.copy(item, depth + 1) for item in value]
        if type(value) is float and not math.isfinite(value):
            raise ChampionError("refused: a number is not finite")
        if type(value) is str and not _is_text(value):
            raise ChampionError(f"refused: a text is not Unicode: {value!a:.60}")
        if type(value) is int and value.bit_length() > MAX_INTEGER_BITS:
            raise ChampionError(f"refused: an integer has more than {MAX_INTEGER_BITS} bits")
        if value is not None and type(value) not in (str, int, float, bool):
            raise ChampionError(f"refused: a {type(value).__name__} is not plain data")
        return value


def _is_text(value: str) -> bool:
    """False for a text with half of a surrogate pair, which no file can hold."""
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True
