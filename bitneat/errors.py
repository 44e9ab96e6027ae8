# SPDX-License-Identifier: MIT
"""What bitneat raises when the user can mend it: each error carries its whole message in one line."""


class BitneatError(Exception):
    """Bad input, a bad setting or a missing tool.

    The message names what is wrong, where, and what was expected; the command line prints it as it is and exits with
    ``exit_status``.
    """

    exit_status = 2


class CheckFailedError(BitneatError):
    """The input is fine, but what was to be checked does not hold (exit status 1)."""

    exit_status = 1


class MissingExtraError(BitneatError):
    """Something needs an optional dependency that is not installed."""
