# SPDX-License-Identifier: MIT
"""Pages that programs write a part of."""


def replaced(page: str, mark: str, text: str) -> str:
    """The page with another text between the two comments of this mark.

    Raises:
        ValueError: if the page does not have both.
    """
    start, end = f"<!-- {mark} -->\n", f"<!-- end of {mark} -->\n"
    before, rest = page.split(start)
    _, after = rest.split(end)
    return f"{before}{start}{text}{end}{after}"
