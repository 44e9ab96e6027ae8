# SPDX-License-Identifier: MIT
"""The command line: one file a sub-command. Nothing else of the project imports it."""

from bitneat.cli.main import main

__all__ = ["main"]
