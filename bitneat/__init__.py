# SPDX-License-Identifier: MIT
"""bitneat: evolve ternary neural controllers and deploy them as C that only adds and subtracts."""

from bitneat.version import __version__

__all__ = ["__version__"]
