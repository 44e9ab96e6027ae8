# SPDX-License-Identifier: MIT
"""Measuring bitneat against what it is compared with, side by side in one run. Nothing but the command line imports it."""
