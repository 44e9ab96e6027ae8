# SPDX-License-Identifier: MIT
from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from bitneat.controller import ACTIVATION_NAMES
from bitneat.report.activations import activations_figure, compare, data_digest

DOCS = Path(__file__).parents[2] / "docs"


def test_the_figure_in_the_docs_is_up_to_date() -> None:
    """If not: ``bitneat plot activations -o docs/activations.svg``. Its bytes also depend on the version of Matplotlib."""
    svg = (DOCS / "activations.svg").read_text(encoding="utf-8")
    assert f"<dc:description>{data_digest(compare(8))}</dc:description>" in svg


def test_every_activation_is_compared_over_all_its_arguments() -> None:
    comparisons = compare(6)
    assert tuple(comparison.name for comparison in comparisons) == ACTIVATION_NAMES
    for comparison in comparisons:
        assert len(comparison.z) == len(comparison.integer) == len(comparison.real) == 65535
        assert (comparison.error == comparison.integer - comparison.real).all()


@pytest.mark.parametrize("frac_bits", [4, 8, 12])
def test_the_bounds_in_words_hold(frac_bits: int) -> None:
    for comparison in compare(frac_bits):
        error = np.abs(comparison.error)
        if comparison.verdict == "exact":
            assert not error.any()
        elif comparison.name == "sin":
            near, far = re.findall(r"0\.\d+", comparison.verdict)
            assert error[np.abs(comparison.z) <= 4].max() <= float(near)
            assert error.max() <= float(far) < error.max() + 0.001
        else:
            assert error.max() <= float(comparison.verdict.removeprefix("|error| ≤ ")) < error.max() + 0.001


@pytest.mark.parametrize("file_type", ["svg", "png"])
def test_the_figure_is_the_same_each_time(file_type: str) -> None:
    first = activations_figure(8, file_type)
    assert first == activations_figure(8, file_type)
    assert b"Matplotlib v" not in first


def test_the_svg_has_no_date() -> None:
    assert b"dc:date" not in activations_figure(5, "svg")
