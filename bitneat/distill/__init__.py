# SPDX-License-Identifier: MIT
"""A ternary controller that imitates a float network on the walker (needs ``bitneat[baselines]``). See docs/distill.md."""
