# SPDX-License-Identifier: MIT
"""What bitneat raises when the user can mend it: each error carries its whole message in one line."""

MAX_MESSAGE = 1000
"""Characters of a message; one that quotes more from a file loses its middle."""


class BitneatError(Exception):
    """Bad input, a bad setting or a missing tool.

    The message names what is wrong, where, and what was expected; the command line prints it as it is and exits with
    ``exit_status``. It is one line of printable text whatever it quotes: what a hostile file holds must not reach a terminal.
    """

    exit_status = 2

    def __init__(self, message: str) -> None:
        super().__init__(_one_line(message))


def printable(text: str) -> str:
    """The text with what would control a terminal, or could not be printed, escaped."""
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in text)


def _one_line(text: str) -> str:
    # Cut first, since a file of megabytes may be quoted, and again, since an escape is longer than what it stands for.
    return _cut(printable(" ".join(_cut(text).split("\n"))))


def _cut(text: str) -> str:
    return text if len(text) <= MAX_MESSAGE else f"{text[: MAX_MESSAGE // 2]} … {text[-MAX_MESSAGE // 4 :]}"


class CheckFailedError(BitneatError):
    """The input is fine, but what was to be checked does not hold (exit status 1)."""

    exit_status = 1


class MissingExtraError(BitneatError):
    """Something needs an optional dependency that is not installed."""
