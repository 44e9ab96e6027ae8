# SPDX-License-Identifier: MIT
"""Models that stable-baselines3 2.9.2 and sb3-contrib 2.9.2 saved, with the actions that they predicted for some observations.

The files in ``saved`` are those models' (policies with random weights, all else left out).
"""

from __future__ import annotations

import io
import json
import pickle
import zipfile
from collections import OrderedDict
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from bitneat.controller import Action, BoxAction, DiscreteAction
from bitneat.errors import BitneatError
from bitneat.network import decode
from bitneat.policy import torch_archive
from bitneat.policy.layers import layered_network
from bitneat.policy.stable_baselines import read_layers
from bitneat.policy.torch_archive import read_state

SAVED = Path(__file__).parent / "saved"
CART_POLE = DiscreteAction(2)
PENDULUM = BoxAction((-2.0,), (2.0,), (1,), "float32")


@pytest.mark.parametrize(
    ("name", "action", "shapes"),
    [
        ("ars_pendulum", PENDULUM, [(1, 3)]),
        ("ars_squashed", PENDULUM, [(4, 3), (1, 4)]),
        ("dqn_cartpole", CART_POLE, [(8, 4), (2, 8)]),
        ("ppo_cartpole", CART_POLE, [(8, 4), (8, 8), (2, 8)]),
        ("ppo_pendulum", PENDULUM, [(6, 3), (1, 6)]),
    ],
)
def test_a_saved_policy_acts_as_the_library_predicted(name: str, action: Action, shapes: list[Any]) -> None:
    layers = read_layers((SAVED / f"{name}.zip").read_bytes(), action)
    assert [layer.weights.shape for layer in layers] == shapes
    network = layered_network(layers)
    predicted = json.loads((SAVED / f"{name}.json").read_text())
    assert np.std(predicted["actions"]) > 0.1
    for observation, expected in zip(predicted["observations"], predicted["actions"], strict=True):
        assert decode(action, network.step(observation)) == pytest.approx(np.array(expected), abs=1e-5)


def changed(name: str, **members: bytes | None) -> bytes:
    """A saved model with other members."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(SAVED / f"{name}.zip") as old, zipfile.ZipFile(buffer, "w") as new:
        content = {entry: old.read(entry) for entry in old.namelist()}
        content.update({key.replace("_", "."): value for key, value in members.items()})  # type: ignore[arg-type]
        for entry, value in content.items():
            if value is not None:
                new.writestr(entry, value)
    return buffer.getvalue()


def settings(**options: Any) -> bytes:
    return json.dumps({"policy_kwargs": options}).encode()


def test_the_saved_activation_counts_unless_another_is_named() -> None:
    relu = "<class 'torch.nn.modules.activation.ReLU'>"
    content = changed("ppo_cartpole", data=settings(activation_fn=relu))
    assert [layer.activation for layer in read_layers(content, CART_POLE)] == ["relu", "relu", "identity"]
    assert [layer.activation for layer in read_layers(content, CART_POLE, "tanh")] == ["tanh", "tanh", "identity"]
    elu = changed("ppo_cartpole", data=settings(activation_fn="<class 'torch.nn.modules.activation.ELU'>"))
    with pytest.raises(BitneatError, match=r"ELU'>\" is not one of Tanh, ReLU.*--activation takes another"):
        read_layers(elu, CART_POLE)
    assert read_layers(elu, CART_POLE, "tanh")[0].activation == "tanh"


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({"policy_pth": None}, "expected the members data and policy.pth"),
        ({"data": b"{"}, "its data is no JSON"),
        ({"data": b"[1]"}, "its data is no JSON object"),
        ({"data": settings(squash_output=True)}, "squashes its actions by gSDE"),
        ({"policy_pth": b"junk"}, "not a zip file"),
    ],
)
def test_what_is_no_such_model_is_refused(members: dict[str, bytes | None], message: str) -> None:
    with pytest.raises(BitneatError, match=message):
        read_layers(changed("ppo_pendulum", **members), PENDULUM)


class Name:
    """Pickles as a global of any module, called with arguments."""

    def __init__(self, module: str, name: str, *arguments: Any) -> None:
        self.module, self.name, self.arguments = module, name, arguments


class Storage:
    def __init__(self, kind: str, key: str, count: int) -> None:
        self.identity = (kind, key, count)


class Writer(pickle._Pickler):  # type: ignore[name-defined, misc]
    """Writes what torch.save writes, without torch, by the layout of its files."""

    def persistent_id(self, value: Any) -> Any:
        if isinstance(value, Storage):
            kind, key, count = value.identity
            return "storage", Global("torch", kind), key, "cpu", count
        return None

    def save_name(self, value: Name) -> None:
        self.save_global_name(Global(value.module, value.name))
        self.save(value.arguments)
        self.write(pickle.REDUCE)

    def save_global_name(self, value: Any) -> None:
        self.write(b"c%s\n%s\n" % (value.module.encode(), value.name.encode()))

    dispatch: ClassVar[dict[Any, Any]] = dict(pickle._Pickler.dispatch)  # type: ignore[attr-defined]


class Global:
    def __init__(self, module: str, name: str) -> None:
        self.module, self.name = module, name


Writer.dispatch[Name] = Writer.save_name
Writer.dispatch[Global] = Writer.save_global_name


def tensor(key: str, count: int, size: tuple[int, ...], stride: tuple[int, ...], offset: int = 0,
           kind: str = "FloatStorage") -> Name:  # fmt: skip
    hooks = Name("collections", "OrderedDict")
    return Name("torch._utils", "_rebuild_tensor_v2", Storage(kind, key, count), offset, size, stride, False, hooks)


def torch_file(state: Any, storages: dict[str, np.ndarray], order: str = "little") -> bytes:
    pickled = io.BytesIO()
    Writer(pickled, protocol=2).dump(state)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        file.writestr("archive/data.pkl", pickled.getvalue())
        file.writestr("archive/byteorder", order)
        for key, numbers in storages.items():
            file.writestr(f"archive/data/{key}", numbers.tobytes())
    return buffer.getvalue()


def test_tensors_are_views_of_storages() -> None:
    numbers = np.arange(12, dtype=np.float32)
    state = {
        "whole": tensor("0", 12, (3, 4), (4, 1)),
        "transposed": tensor("0", 12, (4, 2), (1, 4), 4),
        "scalar": tensor("0", 12, (), (), 5),
        "empty": tensor("0", 12, (0, 3), (3, 1)),
        "big": tensor("1", 2, (2,), (1,), kind="DoubleStorage"),
        "note": "no tensor",
    }
    for order, sign in (("little", "<"), ("big", ">")):
        storages = {"0": numbers.astype(f"{sign}f4"), "1": np.array([1.5, -2.0], f"{sign}f8")}
        read = read_state(torch_file(state, storages, order))
        assert set(read) == set(state) - {"note"}
        assert (read["whole"] == numbers.reshape(3, 4)).all()
        assert (read["transposed"] == numbers.reshape(3, 4)[1:].T).all()
        assert read["scalar"] == 5.0
        assert read["empty"].shape == (0, 3)
        assert read["big"].tolist() == [1.5, -2.0]


@pytest.mark.parametrize(
    ("state", "message"),
    [
        (Name("posix", "system", "true"), r"refused: the pickle calls posix\.system, which can run code"),
        ({"w": Name("torch._utils", "_rebuild_anything", 1)}, "refused: the pickle calls torch._utils._rebuild_any"),
        ({"w": tensor("0", 4, (2, 3), (3, 1))}, "a tensor is larger than its storage"),
        ({"w": tensor("0", 4, (4,), (1,), 1)}, "a tensor is larger than its storage"),
        ({"w": tensor("0", 4, (10**6, 10**6), (0, 0))}, "more than 4000000 numbers"),
        ({str(i): tensor("0", 4, (10**6,), (0,)) for i in range(5)}, "more than 4000000 numbers"),
        ({"w": tensor("0", 4, (-1,), (1,))}, "malformed"),
        ({"w": tensor("0", 4, (2,), (-1,))}, "malformed"),
        ({"w": tensor("9", 4, (2,), (1,))}, "has no member 'archive/data/9'"),
        ({"w": tensor("0", 4, (2,), (1,), kind="BFloat16Storage")}, "refused: a BFloat16Storage"),
        ({"w": tensor("../../data.pkl", 4, (2,), (1,))}, "has no member"),
        ([1, 2], "refused: the pickle uses EMPTY_LIST"),
        ("text", "expected the state of a module"),
        ({1: 2}, "it sets an item of what is no dictionary"),
    ],
)
def test_files_that_torch_would_not_have_saved_are_refused(state: Any, message: str) -> None:
    with pytest.raises(BitneatError, match=message):
        read_state(torch_file(state, {"0": np.zeros(4, np.float32)}))


def test_damaged_pickles_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = torch_file({"w": tensor("0", 4, (4,), (1,))}, {"0": np.zeros(4, np.float32)})
    with zipfile.ZipFile(io.BytesIO(whole)) as file:
        pickled = file.read("archive/data.pkl")
    for end in range(len(pickled)):
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w") as file:
            file.writestr("archive/data.pkl", pickled[:end])
            file.writestr("archive/data/0", bytes(16))
        with pytest.raises(BitneatError):
            read_state(buffer.getvalue())
    monkeypatch.setattr(torch_archive, "_MAX_OPCODES", 10)
    with pytest.raises(BitneatError, match="more than 10 operations"):
        read_state(whole)


def test_policies_of_other_kinds_are_refused() -> None:
    zeros = {"0": np.zeros(4, np.float32)}
    for name, message in (
        ("features_extractor.cnn.0.weight", "only policies of plain linear layers"),
        ("actor.mu.weight", "none of ARS, DQN"),
        ("action_net.weight", None),
    ):
        content = changed("ars_pendulum", policy_pth=torch_file({name: tensor("0", 4, (1, 3), (3, 1))}, zeros))
        if message is None:
            assert read_layers(content, PENDULUM)[0].weights.shape == (1, 3)
        else:
            with pytest.raises(BitneatError, match=message):
                read_layers(content, PENDULUM)


def test_the_writer_of_these_tests_is_read_as_the_library_is() -> None:
    """The stand-in for torch.save must make what torch makes: same operations, same names."""
    import pickletools

    with zipfile.ZipFile(SAVED / "ars_pendulum.zip") as model:
        content = model.read("policy.pth")
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        theirs = {op.name for op, _, _ in pickletools.genops(file.read("archive/data.pkl"))}
    ours_file = torch_file({"w": tensor("0", 4, (4,), (1,))}, {"0": np.zeros(4, np.float32)})
    with zipfile.ZipFile(io.BytesIO(ours_file)) as file:
        ours = {op.name for op, _, _ in pickletools.genops(file.read("archive/data.pkl"))}
    assert ours - theirs <= {"LONG_BINPUT", "TUPLE1", "BININT2", "BININT"}
    assert OrderedDict(read_state(content)).keys() == {"action_net.0.weight"}
