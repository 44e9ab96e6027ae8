# SPDX-License-Identifier: MIT
"""The host's side of a controller: from observations to signals, and from signals to actions.

Both directions work in float64 and are part of the semantics (`docs/semantics.md`), so that every host gives the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bitneat.controller.ir import Controller
from bitneat.errors import BitneatError

if TYPE_CHECKING:  # numpy is imported where arrays are made, so that code generation can do without
    import numpy as np
    import numpy.typing as npt

    Int16Array = npt.NDArray[np.int16]

_DTYPES = frozenset(
    ("float16", "float32", "float64", *(f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)))
)


class Encoder:
    """Turns observations into a controller's input signals: ``clip(rint(obs * 2^(F+s)), -L, L)``, ties to even."""

    def __init__(self, controller: Controller) -> None:
        import numpy as np

        self._factor = np.array([2.0 ** (controller.frac_bits + i.scale) for i in controller.inputs])
        self._limit = np.array([float(i.limit) for i in controller.inputs])

    def __call__(self, observation: npt.ArrayLike) -> Int16Array:
        """Encode an observation of shape (..., inputs), flattened beforehand if it has more axes.

        Raises:
            BitneatError: if a component is NaN, or there are not as many components as inputs.
        """
        import numpy as np

        try:
            values = np.asarray(observation, dtype=np.float64)
        except (TypeError, ValueError):
            raise BitneatError("observation: expected an array of numbers") from None
        if values.shape[-1:] != self._factor.shape:
            raise BitneatError(
                f"observation: expected {self._factor.size} components, got an array of shape {values.shape}"
            )
        # The product is exact or overflows to an infinity, which the clip then takes to the limit as it must.
        with np.errstate(over="ignore"):
            scaled = np.rint(values * self._factor)
        if np.isnan(scaled).any():
            where = int(np.argwhere(np.isnan(scaled))[0][-1])
            raise BitneatError(f"observation[{where}]: is NaN, expected a number")
        result: Int16Array = np.minimum(np.maximum(scaled, -self._limit), self._limit).astype(np.int16)
        return result


@dataclass(frozen=True, slots=True)
class BoxAction:
    """A bounded Box: each output y gives ``low + (clip(y / 2^F, -1, 1) + 1) / 2 * (high - low)``.

    ``low`` and ``high`` are flat, ``shape`` and ``dtype`` are the space's own.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    shape: tuple[int, ...]
    dtype: str

    def __post_init__(self) -> None:
        if not self.low or len(self.low) != len(self.high) or math.prod(self.shape) != len(self.low):
            raise BitneatError("action space: low, high and shape of the Box do not agree")
        if min(self.shape, default=1) < 1:
            raise BitneatError("action space: the shape of the Box has an axis without components")
        # high - low enters the formula, so it must be finite too.
        if not all(math.isfinite(b - a) and a <= b for a, b in zip(self.low, self.high, strict=True)):
            raise BitneatError("action space: expected a Box with finite bounds, low <= high, and a finite width")
        if self.dtype not in _DTYPES:
            raise BitneatError(f"action space: cannot decode to dtype {self.dtype!r}")

    @property
    def num_outputs(self) -> int:
        """Outputs that a controller for this action needs."""
        return len(self.low)

    def decode(self, outputs: Int16Array, frac_bits: int) -> npt.NDArray[Any]:
        """The action for output signals of shape (num_outputs,), in the space's shape and dtype."""
        import numpy as np

        low = np.array(self.low)
        action = np.clip(outputs.astype(np.float64) / (1 << frac_bits), -1.0, 1.0)
        scaled = low + (action + 1.0) / 2.0 * (np.array(self.high) - low)
        decoded: npt.NDArray[Any] = scaled.astype(self.dtype).reshape(self.shape)
        return decoded

    def to_data(self) -> dict[str, Any]:
        """Plain data that `action_from_data` reads back."""
        return {
            "kind": "box",
            "low": list(self.low),
            "high": list(self.high),
            "shape": list(self.shape),
            "dtype": self.dtype,
        }


@dataclass(frozen=True, slots=True)
class DiscreteAction:
    """A choice of n: the index of the largest output, the lowest of equals, plus ``start``."""

    n: int
    start: int = 0

    def __post_init__(self) -> None:
        if type(self.n) is not int or type(self.start) is not int or self.n < 1:
            raise BitneatError(f"action space: expected a Discrete(n >= 1), got n={self.n!r}, start={self.start!r}")

    @property
    def num_outputs(self) -> int:
        """Outputs that a controller for this action needs."""
        return self.n

    def decode(self, outputs: Int16Array, frac_bits: int) -> int:
        """The action for output signals of shape (n,)."""
        del frac_bits  # an argmax has no scale
        return self.start + int(outputs.argmax())

    def to_data(self) -> dict[str, Any]:
        """Plain data that `action_from_data` reads back."""
        return {"kind": "discrete", "n": self.n, "start": self.start}


Action = BoxAction | DiscreteAction


def action_from_data(data: object) -> Action:
    """Read what ``to_data`` of an action wrote.

    Raises:
        BitneatError: if a key is missing or unknown, or a value cannot be.
    """
    if not isinstance(data, Mapping) or data.get("kind") not in ("box", "discrete"):
        raise BitneatError("action: expected a mapping whose 'kind' is 'box' or 'discrete'")
    expected = {"box": {"kind", "low", "high", "shape", "dtype"}, "discrete": {"kind", "n", "start"}}[data["kind"]]
    if set(data) != expected:
        raise BitneatError(f"action: expected the keys {', '.join(sorted(expected))}, got {', '.join(map(str, data))}")
    if data["kind"] == "discrete":
        return DiscreteAction(data["n"], data["start"])
    if not isinstance(data["dtype"], str):
        raise BitneatError("action.dtype: expected the name of a type")
    try:
        return BoxAction(
            _numbers(data["low"], "low", (int, float)),
            _numbers(data["high"], "high", (int, float)),
            tuple(int(v) for v in _numbers(data["shape"], "shape", (int,))),
            data["dtype"],
        )
    except (TypeError, ValueError, OverflowError) as error:
        raise BitneatError(f"action: {error}") from None


def _numbers(values: object, key: str, types: tuple[type, ...]) -> tuple[float, ...]:
    if not isinstance(values, (list, tuple)) or not all(type(value) in types for value in values):
        raise BitneatError(f"action.{key}: expected a list of numbers")
    return tuple(values if types == (int,) else map(float, values))
