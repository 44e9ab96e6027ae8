# SPDX-License-Identifier: MIT
"""``python -m benchmarks.peers``, from the checkout: measures all generators and writes their section of docs/benchmarks.md."""

from __future__ import annotations

import shutil
import sys
from importlib.util import find_spec

from benchmarks.peers.networks import ROOT

PACKAGES = ("emlearn", "emx_onnx_cgen", "onnx", "unicorn")


def main() -> int:
    """Check that everything is there, then measure; the exit status."""
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        print(f"peers: {', '.join(missing)} missing; pip install 'bitneat[peers]'", file=sys.stderr)
        return 2
    if shutil.which("arm-none-eabi-gcc") is None:
        print("peers: arm-none-eabi-gcc missing; Debian: apt install gcc-arm-none-eabi", file=sys.stderr)
        return 2
    from benchmarks.peers.report import write

    page = ROOT / "docs" / "benchmarks.md"
    write(page, lambda what: print(what, flush=True))
    print(f"written: {page.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
