"""How the cost grows: slopes of power laws, and a table of small runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from benchmarks import scaling


def test_the_slope_of_a_power_law_is_its_exponent() -> None:
    x = np.array([1.0, 2.0, 5.0])
    assert scaling.slope(x, 3 * x**0.7) == pytest.approx(0.7)


def test_growth_compares_the_end_with_the_second_quarter() -> None:
    flat = np.ones((40, 5))
    assert scaling.growth(flat) == 1.0
    flat[30:] = 3.0
    assert scaling.growth(flat) == 3.0


def test_every_run_has_a_row_and_the_growth_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scaling, "THRESHOLDS", (0.4, 0.25))
    monkeypatch.setattr(scaling, "FEATURES", (20, 60))
    console = Console(width=200, quiet=True)
    options = ["--resolutions", "120x90", "--seconds", "0.4", "--output", str(tmp_path)]
    scaling.main(options, console)
    text = (tmp_path / "scaling.md").read_text()
    assert text.count("\n| 120x90") == 5
    assert text.count("slope") == 3 and "last quarter" in text
