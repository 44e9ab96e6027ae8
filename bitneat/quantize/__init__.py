# SPDX-License-Identifier: MIT
"""From float networks to controllers, and from integer controllers to ternary ones. Pure functions, without any environment."""

from bitneat.quantize.draft import QuantizeError
from bitneat.quantize.exact import to_ternary
from bitneat.quantize.gains import spend_gains
from bitneat.quantize.rounding import round_weights, threshold_weights

__all__ = ["QuantizeError", "round_weights", "spend_gains", "threshold_weights", "to_ternary"]
