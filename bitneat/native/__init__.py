# SPDX-License-Identifier: MIT
"""C on the host: which compiler there is, what it has built before, and where the packaged C and templates lie."""

from bitneat.native.build import compile_object, shared_library
from bitneat.native.compiler import Compiler, host_compiler, identify, zig_compiler
from bitneat.native.data import runtime_dir, templates_dir

__all__ = [
    "Compiler",
    "compile_object",
    "host_compiler",
    "identify",
    "runtime_dir",
    "shared_library",
    "templates_dir",
    "zig_compiler",
]
