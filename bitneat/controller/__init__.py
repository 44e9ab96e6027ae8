# SPDX-License-Identifier: MIT
"""The controller IR, its exact semantics and its packed form. Imports nothing of the project but its own parts."""

from bitneat.controller.activation import ACTIVATION_NAMES
from bitneat.controller.coding import Action, BoxAction, DiscreteAction, Encoder, action_from_data
from bitneat.controller.ir import Constant, Controller, ControllerError, Input, Link, Node, Output, Signal, State
from bitneat.controller.reference import Reference

__all__ = [
    "ACTIVATION_NAMES",
    "Action",
    "BoxAction",
    "Constant",
    "Controller",
    "ControllerError",
    "DiscreteAction",
    "Encoder",
    "Input",
    "Link",
    "Node",
    "Output",
    "Reference",
    "Signal",
    "State",
    "action_from_data",
]
