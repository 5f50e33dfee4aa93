"""Latency of the live odometry, and what it sheds, on a short recording."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.live import LiveRun, largest_distance, live_run
from gpvo import Odometry
from gpvo.live.latency import Latency
from gpvo.live.load import Level
from gpvo.simulation import SimulationConfig, simulate


def test_a_run_has_latencies_and_says_how_far_its_path_is_off() -> None:
    config = SimulationConfig(seed=2, duration=0.5, resolution=(160, 120), focal_length=105.0)
    recording = simulate(config)
    reference = Odometry(recording.rig).run(recording)
    assert largest_distance(reference, reference) == 0
    found = live_run(recording, 0.5, reference)
    assert 0 < found.latency[0] <= found.latency[1] <= found.latency[2]
    assert 0 <= found.shed < 1 and found.error >= 0
    assert found.worst != Level() or found.error == 0
    assert len(found.row().split()) == 8


def test_the_table_has_a_column_for_each_number() -> None:
    row = LiveRun(1.0, (0.01, 0.02, 0.03), 0.5, Level(1.5, 0.7), 0.004).row()
    assert row.split() == ["1", "10", "20", "30", "50.0", "1.50", "70", "4.0"]


def test_latency_is_from_the_packet_of_the_last_event() -> None:
    """Packets of 5 ms arrive 1 ms after their end; clusters end at 7 ms and 12 ms."""
    latency = Latency()
    for index in range(4):
        latency.arrived(5_000_000 * index, 0.005 * (index + 1) + 0.001)
    latency.estimated(7_000_000, 0.050)
    latency.estimated(12_000_000, 0.060)
    np.testing.assert_allclose(latency.seconds, [0.050 - 0.011, 0.060 - 0.016])
    assert latency.percentiles()[0] == pytest.approx(0.0415)
    assert np.isnan(Latency().percentiles()).all()
