# SPDX-License-Identifier: MIT
"""Simulators: Gymnasium environments, and episodes of a controller in them."""
