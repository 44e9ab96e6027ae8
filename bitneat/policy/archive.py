# SPDX-License-Identifier: MIT
"""Members of zip files that may be anyone's: read up to a limit, whatever they claim to be."""

from __future__ import annotations

import io
import zipfile

from bitneat.policy.layers import PolicyError

MAX_FILE_BYTES = 64 * 1024 * 1024
MAX_MEMBER_BYTES = 64 * 1024 * 1024
_MAX_MEMBERS = 4096


class Archive:
    """A zip file in memory.

    Raises:
        PolicyError: if it is none, or has thousands of members.
    """

    def __init__(self, content: bytes) -> None:
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(content))
            self.names = self._zip.namelist()
        except Exception as error:  # a damaged zip can make zipfile raise nearly anything
            raise PolicyError(f"not a zip file, or a damaged one ({type(error).__name__})") from None
        if len(self.names) > _MAX_MEMBERS:
            raise PolicyError(f"refused: more than {_MAX_MEMBERS} members")
        self._left = MAX_MEMBER_BYTES

    def read(self, name: str) -> bytes:
        """A member; all that are read together must not exceed `MAX_MEMBER_BYTES`.

        Raises:
            PolicyError: if it is missing, damaged, encrypted or too large.
        """
        if name not in self.names:
            raise PolicyError(f"has no member {name!r:.80}")
        try:
            with self._zip.open(name) as member:
                content = member.read(self._left + 1)
        except Exception as error:
            raise PolicyError(f"member {name!r:.80} is damaged ({type(error).__name__})") from None
        if len(content) > self._left:
            raise PolicyError(f"refused: its members exceed {MAX_MEMBER_BYTES} bytes")
        self._left -= len(content)
        return content
