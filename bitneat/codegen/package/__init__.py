# SPDX-License-Identifier: MIT
"""Generated C as a library of an embedded ecosystem: which files there are, what they say, and a folder to write them to."""

from bitneat.codegen.package.files import KINDS, package_files
from bitneat.codegen.package.folder import write_package
from bitneat.codegen.package.view import Package, PackageError, flash_bytes

__all__ = ["KINDS", "Package", "PackageError", "flash_bytes", "package_files", "write_package"]
