# SPDX-License-Identifier: MIT
"""The version of bitneat, read by the build backend and printed into every generated file, and those of other packages."""

__version__ = "0.2.0"


def installed_version(name: str) -> str | None:
    """The version of a distribution, or None if it is not installed."""
    from importlib import metadata

    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
