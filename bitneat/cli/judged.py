# SPDX-License-Identifier: MIT
"""Which generated C a command judges: the file that was named or found, else one made for the purpose."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from bitneat.champion import Champion
    from bitneat.codegen import Style
    from bitneat.verify.cfile import CFile


def code_to_judge(
    champion: Champion, path: Path, named: Path | None, style: Style | Literal["auto"], folder: Path
) -> tuple[CFile, bool]:
    """The file to judge, and whether it is one that was handed out; prints which it is.

    Args:
        champion: whose C it is.
        path: where the champion came from.
        named: the file that the user names.
        style: of a file that has to be generated because there is none.
        folder: where to put that.

    Raises:
        BitneatError: if the named file is no C of this champion's.
    """
    from bitneat.codegen import generate
    from bitneat.verify.cfile import CFile, c_name_for, find, require_related

    if named is not None:
        code = CFile.read(named)
        require_related(code, champion, path)
        return code, True
    found = find(champion, path, (path.parent, Path.cwd()))
    if found.stale is not None:
        return found.stale, True
    if found.matching:
        first, *others = found.matching
        if others:
            names = ", ".join(str(code.path) for code in others)
            print(f"also generated for this controller, not checked now: {names}")
        return first, True
    made = generate(
        champion.controller,
        c_name_for(path),
        style,
        action=champion.action,
        environment_id=champion.environment.id if champion.environment else "",
    )
    print(f"no generated C for this controller beside {path} or here: generated it for this check alone")
    return CFile.write(made, folder), False
