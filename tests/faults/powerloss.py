# SPDX-License-Identifier: MIT
"""A model of a disk on which only what was synced is sure to outlast a loss of power.

It carries out a log of calls on names and contents in memory and knows of each folder its names, and of each file its content,
both now and as of the last sync. A file system may have written more than was asked for; the two extremes are what is tried.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.faults.warm import Call, Tree


@dataclass
class File:
    content: bytes = b""
    synced: bytes = b""


@dataclass
class Folder:
    names: dict[str, File | Folder] = field(default_factory=dict)
    synced: dict[str, File | Folder] = field(default_factory=dict)


class Disk:
    """The disk below ``place``, as it was in ``before``, all of it synced."""

    def __init__(self, before: Path, place: Path) -> None:
        self.place = place
        self.top = self._read(before)

    def _read(self, path: Path) -> Folder:
        folder = Folder()
        for entry in path.iterdir():
            node: File | Folder
            if entry.is_dir():
                node = self._read(entry)
            else:
                node = File(entry.read_bytes(), entry.read_bytes())
            folder.names[entry.name] = folder.synced[entry.name] = node
        return folder

    def _parent(self, path: str) -> tuple[Folder, str]:
        *above, name = Path(path).relative_to(self.place).parts
        folder = self.top
        for part in above:
            inner = folder.names[part]
            assert isinstance(inner, Folder)
            folder = inner
        return folder, name

    def _node(self, path: str) -> File | Folder:
        if Path(path) == self.place:
            return self.top
        folder, name = self._parent(path)
        return folder.names[name]

    def do(self, call: Call) -> None:
        """Carry out a call of a program; one that failed there, since a name was missing or taken, changes nothing."""
        if not Path(call.path).is_absolute():  # by a descriptor of its folder, of temporary files that are taken away
            return
        try:
            getattr(self, f"_{call.name}")(call)
        except KeyError:
            assert call.name in ("unlink", "mkdir", "rmdir", "link"), call

    def _mkdir(self, call: Call) -> None:
        folder, name = self._parent(call.path)
        folder.names.setdefault(name, Folder())

    def _create(self, call: Call) -> None:
        folder, name = self._parent(call.path)
        folder.names[name] = File()

    def _open(self, call: Call) -> None:
        folder, name = self._parent(call.path)
        folder.names.setdefault(name, File())

    def _truncate(self, call: Call) -> None:
        self._open(call)
        node = self._node(call.path)
        assert isinstance(node, File)
        node.content = b""

    def _write(self, call: Call) -> None:
        node = self._node(call.path)
        assert isinstance(node, File)
        node.content += call.data

    def _fchmod(self, call: Call) -> None:
        pass

    def _fsync(self, call: Call) -> None:
        node = self._node(call.path)
        if isinstance(node, File):
            node.synced = node.content
        else:
            node.synced = dict(node.names)

    def _unlink(self, call: Call) -> None:
        folder, name = self._parent(call.path)
        del folder.names[name]

    _rmdir = _unlink

    def _rename(self, call: Call) -> None:
        folder, name = self._parent(call.path)
        node = folder.names.pop(name)
        target, new = self._parent(call.other)
        target.names[new] = node

    def _link(self, call: Call) -> None:
        target, new = self._parent(call.other)
        target.names[new] = self._node(call.path)

    def current(self) -> Tree:
        """What programs see."""
        return self._flat(self.top, "", names=True, content=True)

    def after_power_loss(self, *, names: bool) -> Tree:
        """What is there afterwards: the synced content of files, under all names or under synced ones only."""
        return self._flat(self.top, "", names=names, content=False)

    def _flat(self, folder: Folder, prefix: str, *, names: bool, content: bool) -> Tree:
        found: Tree = {}
        for name, node in (folder.names if names else folder.synced).items():
            if isinstance(node, File):
                found[prefix + name] = node.content if content else node.synced
            else:
                found[prefix + name] = None
                found |= self._flat(node, f"{prefix}{name}/", names=names, content=content)
        return found

    @staticmethod
    def put(tree: Tree, folder: Path) -> None:
        """Write it out."""
        folder.mkdir()
        for name, content in tree.items():
            if content is None:
                (folder / name).mkdir()
            else:
                (folder / name).write_bytes(content)
