# SPDX-License-Identifier: MIT
"""Proof that compiled machine code computes a controller, for every input and every state."""
