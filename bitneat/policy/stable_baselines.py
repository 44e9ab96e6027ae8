# SPDX-License-Identifier: MIT
"""Policies that stable-baselines3 and sb3-contrib saved: ARS, DQN, and those with an actor (PPO, A2C, TRPO).

A saved model is a zip with JSON, whose objects are pickles in base64, and the policy's tensors. Of the JSON, only texts are
looked at, and `bitneat.policy.torch_archive` reads the tensors. So nothing in the file is executed, and neither library is needed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from bitneat.controller import Action, BoxAction
from bitneat.policy.archive import Archive
from bitneat.policy.layers import Floats, Layer, PolicyError, with_unit_actions
from bitneat.policy.torch_archive import read_state

POLICY_MEMBER = "policy.pth"

_ACTIVATIONS = {"Tanh": "tanh", "ReLU": "relu", "Sigmoid": "sigmoid", "Identity": "identity"}
_ACTIVATION = re.compile(r"torch\.nn\.modules\.(?:activation|linear)\.(\w+)")


def read_layers(content: bytes, action: Action, activation: str | None = None) -> list[Layer]:
    """The layers of the policy in a saved model; outputs are as a controller's, from -1 to 1 for a Box.

    It acts as the library's ``predict(…, deterministic=True)``: the mean action of an actor, cut off at the bounds; the largest of
    values or logits.

    Args:
        content: of the zip file.
        action: the environment's.
        activation: of hidden layers; by default what the file says, or the library's own default.

    Raises:
        PolicyError: if it is no such file, or the policy is of another kind. Nothing in the file is executed.
    """
    archive = Archive(content)
    if POLICY_MEMBER not in archive.names or "data" not in archive.names:
        raise PolicyError("not a model saved by stable-baselines3: expected the members data and policy.pth")
    settings = _settings(archive.read("data"))
    state = read_state(archive.read(POLICY_MEMBER))
    for name in state:
        if "features_extractor." in name or "shared_net." in name:
            raise PolicyError(f"has {name!r:.80}; only policies of plain linear layers are read")
    options = settings.get("policy_kwargs")
    options = options if isinstance(options, Mapping) else {}
    if any(name.startswith("q_net.q_net.") for name in state):
        return _sequence(state, "q_net.q_net.", activation or _activation(options, "relu"), "identity")
    if any(name.startswith("mlp_extractor.policy_net.") for name in state) or "action_net.weight" in state:
        if options.get("squash_output") is True:
            raise PolicyError("squashes its actions by gSDE, which is not read")
        hidden = _sequence(state, "mlp_extractor.policy_net.", activation or _activation(options, "tanh"), None)
        layers = [*hidden, _layer(state, "action_net", "identity")]
        return with_unit_actions(layers, action.low, action.high) if isinstance(action, BoxAction) else layers
    if any(name.startswith("action_net.") for name in state):
        squashed = isinstance(action, BoxAction) and options.get("squash_output", not _is_linear(settings)) is not False
        layers = _sequence(
            state, "action_net.", activation or _activation(options, "relu"), "tanh" if squashed else "identity"
        )
        if isinstance(action, BoxAction) and not squashed:
            return with_unit_actions(layers, action.low, action.high)
        return layers
    raise PolicyError("its policy is none of ARS, DQN, or an actor with an mlp_extractor")


def _settings(content: bytes) -> Mapping[str, Any]:
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise PolicyError(f"its data is no JSON ({type(error).__name__})") from None
    if not isinstance(data, Mapping):
        raise PolicyError("its data is no JSON object")
    return data


def _is_linear(settings: Mapping[str, Any]) -> bool:
    """Whether the policy is ARS's linear one, whose outputs are cut off where those of its MLP go through tanh."""
    described = settings.get("policy_class")
    return isinstance(described, Mapping) and "ARSLinearPolicy" in str(described.get("__init__"))[:200]


def _activation(options: Mapping[str, Any], default: str) -> str:
    text = options.get("activation_fn")
    if text is None:
        return default
    found = _ACTIVATION.search(text) if isinstance(text, str) else None
    name = _ACTIVATIONS.get(found.group(1)) if found else None
    if name is None:
        known = ", ".join(_ACTIVATIONS)
        raise PolicyError(
            f"its activation_fn {text!r:.80} is not one of {known}; --activation takes another in its place"
        )
    return name


def _sequence(state: Mapping[str, Floats], prefix: str, hidden: str, output: str | None) -> list[Layer]:
    """The linear layers of a ``torch.nn.Sequential``; all are hidden ones if no output's activation is given."""
    pattern = re.compile(re.escape(prefix) + r"(\d{1,4})\.weight")
    places = sorted(int(found.group(1)) for name in state if (found := pattern.fullmatch(name)))
    last = places[-1] if places and output is not None else None
    return [
        _layer(state, f"{prefix}{place}", output if place == last and output is not None else hidden)
        for place in places
    ]


def _layer(state: Mapping[str, Floats], name: str, activation: str) -> Layer:
    weights = state.get(f"{name}.weight")
    if weights is None or weights.ndim != 2:
        raise PolicyError(f"has no matrix {name}.weight")
    bias = state.get(f"{name}.bias", np.zeros(len(weights)))
    return Layer(weights, bias, activation)
