# SPDX-License-Identifier: MIT
"""What every test shares: where native code is built, and how much work a test may do."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).resolve().parents[1]
BUDGET = int(os.environ.get("BITNEAT_TEST_BUDGET", "1"))

# Shared by all workers, and apart from the user's own cache, which must not fill with what tests compile.
os.environ.setdefault("BITNEAT_CACHE_DIR", str(ROOT / "build" / "test-cache"))

# The ordinary run is the same every time; the long one looks for new cases.
settings.register_profile("short", derandomize=True, deadline=None, max_examples=100)
settings.register_profile("long", deadline=None, max_examples=100 * BUDGET, print_blob=True)
settings.load_profile("short" if BUDGET == 1 else "long")


@pytest.fixture(scope="session")
def budget() -> int:
    """How many times the ordinary number of random cases to try: 1 in ``make test``, more in ``make test-long``."""
    return BUDGET
