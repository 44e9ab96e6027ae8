# SPDX-License-Identifier: MIT
"""The version of bitneat, read by the build backend and printed into every generated file."""

__version__ = "0.2.0"
