"""Departures from the paper: each can be undone alone, and together they are the paper's preset."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.departures import (
    DEPARTURES,
    differing,
    paper_values,
    run_errors,
    summary,
    variants,
)
from gpvo.config import Configuration
from gpvo.simulation import SimulatedRecording


def test_all_that_the_presets_differ_in_is_undone() -> None:
    """The defaults with all departures undone are the paper's preset."""
    assert {field for fields in DEPARTURES.values() for field in fields} <= set(differing())
    undone = Configuration(**paper_values(differing())).model_dump()
    assert undone == Configuration(preset="paper").model_dump() | {"preset": "auto"}


def test_every_departure_is_undone_alone() -> None:
    dumped = [each.model_dump_json() for each in variants().values()]
    assert len(set(dumped)) == len(dumped) >= len(DEPARTURES) + 2


def test_a_variant_has_errors(recording: SimulatedRecording) -> None:
    position, step = run_errors(recording, variants()["tracklets of 40 ms"])
    assert 0 < position < 0.1 and 0 < step < 0.01


def test_the_table_has_geometric_means_over_the_runs_that_did_not_fail() -> None:
    runs = [
        {"defaults": (0.01, 1e-3), "twice": (0.02, 2e-3), "half": (0.005, 5e-4)},
        {"defaults": (0.02, 1e-3), "twice": (0.04, 2e-3), "half": (np.nan, np.nan)},
        {"defaults": (0.01, 2e-3), "twice": (0.02, 4e-3), "half": (0.005, 4e-3)},
    ]
    twice, half = ([cell.text for cell in row] for row in summary(runs).rows)
    assert twice == ["twice", "2.00 ± 0.00", "2.00 ± 0.00", ""]
    assert half[1].startswith("0.50") and half[3] == "1"
    assert float(half[2].split()[0]) == pytest.approx(1.0)
