# SPDX-License-Identifier: MIT
"""Proofs of a whole file: every function of it, compiled for every pair of target and optimisation, with a cache."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from bitneat.champion import Champion
from bitneat.controller import DiscreteAction
from bitneat.controller.packing import pack_blob
from bitneat.errors import BitneatError
from bitneat.files import make_folder, read_capped, write_atomic
from bitneat.native.build import cache_dir
from bitneat.prove.equivalence import Lemmas
from bitneat.prove.execute import AMD64, CORTEX_M, CORTEX_M0, CORTEX_M4, Processor
from bitneat.prove.given import require_made_for
from bitneat.prove.proof import FunctionProof, prove_function
from bitneat.prove.queries import SOLVERS
from bitneat.prove.subject import Subject
from bitneat.state import seal, unseal
from bitneat.verify.cfile import MAX_FILE_BYTES, CFile
from bitneat.verify.implementation import entries
from bitneat.verify.machine import Toolchain
from bitneat.verify.targets.chip import Chip
from bitneat.verify.targets.chips import CHIPS
from bitneat.verify.targets.emulated import EmulatedC

PROCESSORS: dict[str, Processor] = {
    "x86-64": AMD64,
    "cortex-m0": CORTEX_M0,
    "cortex-m3": CORTEX_M,
    "cortex-m4": CORTEX_M4,
}
"""The targets whose machine code can be executed on terms."""

TARGETS = ("x86-64", "cortex-m0", "cortex-m4")
OPTIMIZATIONS = ("-O0", "-Os", "-O2", "-O3")
"""What is proved unless something else is asked for."""

GIVEN = "given"
"""Level and compiler of a given object, of which nobody can know them."""

PACKAGES = ("pyvex", *SOLVERS)
_MAX_KEPT_BYTES = 1 << 20


@dataclass
class PairProof:
    """All functions of one binary."""

    target: str
    optimization: str
    style: str
    compiler: str
    binary_sha256: str
    """Of the code and constants of the file under test, as linked."""
    functions: list[FunctionProof] = field(default_factory=list)
    cached: bool = False

    @property
    def proved(self) -> bool:
        """Whether all are."""
        return all(one.verdict == "proved" for one in self.functions)

    @property
    def verdict(self) -> str:
        """The worst of them."""
        found = {one.verdict for one in self.functions}
        return next(verdict for verdict in ("refuted", "not proved", "proved") if verdict in found)

    @property
    def seconds(self) -> float:
        """What it took."""
        return sum(one.seconds for one in self.functions)

    def to_data(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "target": self.target,
            "optimization": self.optimization,
            "style": self.style,
            "compiler": self.compiler,
            "binary_sha256": self.binary_sha256,
            "verdict": self.verdict,
            "cached": self.cached,
            "functions": [one.to_data() for one in self.functions],
        }


@dataclass
class ProofReport:
    """What was proved of a champion's C."""

    champion: Champion
    files: list[CFile]
    paranoid: bool
    pairs: list[PairProof] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether everything was proved, and there was something."""
        return bool(self.pairs) and all(pair.proved for pair in self.pairs)

    def to_data(self) -> dict[str, Any]:
        """As JSON has it; the keys are those of ``verify --json`` where they mean the same."""
        controller = self.champion.controller.canonical
        return {
            "command": "prove",
            "verdict": "pass" if self.passed else "fail",
            "controller": {
                "sha256": controller.sha256,
                "ternary": controller.is_ternary,
                "nodes": len(controller.nodes),
                "links": controller.num_links,
                "packed_bytes": len(pack_blob(controller).data),
            },
            "files": [{"style": code.style, "c_sha256": code.content_sha256} for code in self.files],
            "paranoid": self.paranoid,
            "tools": tool_versions(),
            "pairs": [pair.to_data() for pair in self.pairs],
        }


Note = Callable[[int, int, str], None]
"""Called before each binary and at the end: how many are done, of how many, and what comes."""


def prove(
    champion: Champion,
    files: Sequence[CFile],
    *,
    targets: Sequence[str] = TARGETS,
    optimizations: Sequence[str] = OPTIMIZATIONS,
    compiled: Path | None = None,
    paranoid: bool = False,
    use_cache: bool = True,
    note: Note = lambda done, total, what: None,
) -> ProofReport:
    """Prove that C files, compiled, compute what a champion's controller computes.

    Args:
        champion: whose C it is.
        files: its generated C, in one style or both.
        targets: from `PROCESSORS`.
        optimizations: of the compilers.
        compiled: an object file, made of the one file for the one target, to be proved instead of what the compiler makes.
        paranoid: ask two solvers, and settle each step in every way there is.
        use_cache: take over what was proved of the very same binary before.
        note: told how far it is.

    Raises:
        BitneatError: if a target is unknown, a tool is missing, or a given object is none for its target.
        CompilerError: if a compiler refuses a file.
    """
    require_tools()
    chips = {name: _chip(name) for name in targets}
    if compiled is not None:
        content = read_capped(compiled, MAX_FILE_BYTES)
        for name in targets:
            require_made_for(content, compiled, name, PROCESSORS[name])
    report = ProofReport(champion, list(files), paranoid)
    lemmas = Lemmas()
    work = [
        (code, name, optimization)
        for code in files
        for name in targets
        for optimization in ((GIVEN,) if compiled else optimizations)
    ]
    for done, (code, name, optimization) in enumerate(work):
        note(done, len(work), f"{name} {optimization} {code.style}")
        chip, toolchain = chips[name]
        pair: PairProof | None = None
        for entry in entries(code):
            emulated = chip.implementation(
                code,
                toolchain,
                entry,
                optimization="-Os" if compiled else optimization,
                compiled=compiled,
            )
            try:
                if pair is None:
                    sha256 = hashlib.sha256(emulated.image.controller).hexdigest()
                    compiler = GIVEN if compiled else toolchain.compiler.title
                    pair = PairProof(name, optimization, code.style, compiler, sha256)
                _prove_entry(champion, emulated, pair, lemmas, paranoid=paranoid, use_cache=use_cache)
            finally:
                emulated.close()
        assert pair is not None
        report.pairs.append(pair)
    note(len(work), len(work), "")
    return report


def _prove_entry(
    champion: Champion, emulated: EmulatedC, pair: PairProof, lemmas: Lemmas, *, paranoid: bool, use_cache: bool
) -> None:
    """The function that computes a step and, with the first of them, what stands beside it."""
    code, entry = emulated.image.code, emulated.image.entry
    functions = [entry]
    if entry == "step":
        functions += ["reset"] if code.num_state else []
        functions += ["decide"] if code.has_decide else []
    kept = _kept(champion, emulated, functions, paranoid=paranoid)
    found = _read(kept) if use_cache else None
    if found is not None:
        pair.functions += found
        pair.cached = True
        return
    start = champion.action.start if isinstance(champion.action, DiscreteAction) else 0
    subject = Subject(champion.controller, emulated, PROCESSORS[pair.target], lemmas, start, paranoid)
    proved = [prove_function(subject, function) for function in functions]
    pair.functions += proved
    if use_cache and all(one.verdict == "proved" for one in proved):
        make_folder(kept.parent)
        write_atomic(kept, seal({"functions": [one.to_data() for one in proved]}))


def _chip(name: str) -> tuple[Chip, Toolchain]:
    chip = next((one for one in CHIPS if one.name == name), None)
    if chip is None or name not in PROCESSORS:
        raise BitneatError(f"--targets: {name} is none of {', '.join(PROCESSORS)}, whose machine code can be proved")
    toolchain = chip.toolchain()
    missing = chip.needs if toolchain is None else chip.missing_to_run()
    if toolchain is None or missing is not None:
        raise BitneatError(f"--targets: {name} needs {missing}")
    return chip, toolchain


def require_tools() -> None:
    """Say what to install.

    Raises:
        BitneatError: if a package is missing.
    """
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        raise BitneatError(f"prove needs {' and '.join(missing)}: pip install 'bitneat[prove]'")


def tool_versions() -> dict[str, str]:
    """Of the lifter and the solvers, which a proof trusts."""
    names = {"z3": "z3-solver"}
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(names.get(name, name))
        except PackageNotFoundError:  # a copy that was not installed
            found[name] = "unknown"
    return found


# The cache -----------------------------------------------------------------------------------------------------------


def _kept(champion: Champion, emulated: EmulatedC, functions: Sequence[str], *, paranoid: bool) -> Path:
    """Where a proof of exactly this is kept: of these bytes, by these versions of everything that it trusts."""
    code = emulated.image.code
    parts: list[object] = [
        hashlib.sha256(emulated.image.content).hexdigest(),
        champion.controller.sha256,
        champion.action.to_data(),
        functions,
        [code.num_inputs, code.num_outputs, code.num_signals, code.num_state, code.guard],
        paranoid,
        tool_versions(),
        _own_sources(),
    ]
    key = hashlib.sha256(json.dumps(parts).encode()).hexdigest()
    return cache_dir() / "proofs" / f"{key}.json"


@cache
def _own_sources() -> str:
    """Fingerprint of what proves and of what defines the semantics."""
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for folder in (package, package.parent / "controller"):
        for path in sorted(folder.glob("*.py")):
            digest.update(f"{os.fsdecode(path.name)}\0".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _read(path: Path) -> list[FunctionProof] | None:
    try:
        data = unseal(read_capped(path, _MAX_KEPT_BYTES, regular=True), str(path))
        return [FunctionProof.from_data(one) for one in data["functions"]]
    except (BitneatError, KeyError, TypeError, ValueError):
        return None  # not there, or damaged: then it is proved again
