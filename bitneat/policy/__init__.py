# SPDX-License-Identifier: MIT
"""Policies that other trainers made, as float networks: layers of weights, and the files that hold them."""
