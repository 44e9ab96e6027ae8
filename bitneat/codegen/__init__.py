# SPDX-License-Identifier: MIT
"""From a controller to C: names, views, templates; `generate` is the way in."""

from bitneat.codegen.generate import STYLES, CodegenError, GeneratedC, Style, code_bytes, generate, selftest
from bitneat.codegen.names import CNameError, check_name

__all__ = [
    "STYLES",
    "CNameError",
    "CodegenError",
    "GeneratedC",
    "Style",
    "check_name",
    "code_bytes",
    "generate",
    "selftest",
]
