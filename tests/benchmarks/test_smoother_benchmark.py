"""The benchmarks of the smoother, on tiny simulations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rich.table import Table

from benchmarks import consistency, smoother
from benchmarks.reference_smoother import ReferenceSmoother, long_tracks, position_errors
from benchmarks.smoother import MODES, REFERENCE, compare, compare_tracks, deviation, timed
from gpvo.trajectory import Trajectory


def test_comparison_has_a_row_for_every_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    tables: list[Table] = []
    monkeypatch.setattr(smoother.console, "print", tables.append)
    compare("tiny", *smoother.simulated(0, 5, 12), MODES)
    (table,) = tables
    assert list(table.columns[0].cells) == list(MODES)
    assert not any("failed" in str(cell) for cell in table.columns[-1].cells)


def test_reference_is_near_the_smoother() -> None:
    camera, updates = smoother.simulated(1, 8, 12)
    ours, _ = timed(camera, updates, smoother.UNIQUE, 20)
    theirs, spent = timed(camera, updates, MODES[REFERENCE], 20)
    assert isinstance(ours, Trajectory)
    assert len(spent) == len(updates)
    assert np.median(deviation(theirs, ours)) < 0.1


def test_reference_goes_on_without_tracks_and_with_late_ones() -> None:
    simulation, motion, clusters = long_tracks(0, 5, 6, 0.6)
    nothing = clusters[0][1][:0]
    clusters[6] = clusters[6][0], nothing
    late = clusters[9][1].concatenate([clusters[1][1], clusters[9][1]])
    clusters[9] = clusters[9][0], late
    reference = ReferenceSmoother(simulation.camera, simulation.noise, 0.2, interval=0.03)
    reference.update(0.0, nothing)
    assert len(reference.states) == 0
    for cluster in clusters:
        reference.update(*cluster)
    states = reference.states
    assert np.diff(states.t).max() <= 0.03
    assert position_errors(states, motion, states.t).max() < 0.1


def test_long_tracks_have_a_row_each(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(smoother, "TRACKS", {"some": (5, 5, True)})
    compare_tracks(1, duration=0.6)
    assert "some" in capsys.readouterr().out


def test_long_stream_has_a_row_for_every_minute(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(smoother, "SECONDS", 1)
    smoother.long_stream(2 / 60)
    assert "beyond the trajectory" in capsys.readouterr().out


def test_consistency_is_plotted_for_every_mode(tmp_path: Path) -> None:
    t = np.array([0.2, 0.5])
    means = {mode: consistency.mean_nees(1, x, t) for mode, x in consistency.MODES.items()}
    assert all((lines > 0).all() and lines.shape == (2, 2) for lines in means.values())
    consistency.save_plot(tmp_path / "plot.png", t, means, 1)
    assert (tmp_path / "plot.png").stat().st_size > 1000
