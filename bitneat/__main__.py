# SPDX-License-Identifier: MIT
"""``python -m bitneat`` is the command line."""

import sys

from bitneat.cli import main

if __name__ == "__main__":
    sys.exit(main())
