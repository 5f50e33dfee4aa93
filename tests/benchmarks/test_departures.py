"""Departures from the paper: each can be undone alone, and together they are the paper's preset."""

from __future__ import annotations

import pytest

from benchmarks.departures import DEPARTURES, differing, error_table, paper_values, variants
from benchmarks.front_end import trajectory_errors
from benchmarks.known_motion import KnownRecording
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


def test_errors_of_a_variant_are_in_the_table(recording: SimulatedRecording) -> None:
    known = KnownRecording.simulated("tiny", recording)
    relative, final = trajectory_errors(known, variants()["tracklets of 40 ms"])
    assert 0 < relative < 0.01 and 0 < final < 0.1
    _, percent, _ = error_table("tiny", {"x": (relative, final)}).columns
    assert float(next(iter(percent.cells))) == pytest.approx(100 * final, abs=0.006)
