# SPDX-License-Identifier: MIT
"""BipedalWalker in C: bit for bit Gymnasium's, several walkers at a time. See docs/simulator.md."""
