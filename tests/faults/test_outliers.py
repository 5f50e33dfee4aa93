"""Many landmarks that move otherwise than the camera are told, and a few are not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gpvo import Odometry
from gpvo.cluster_report import ClusterReport
from gpvo.faults.outliers import ENOUGH, MANY, PERIOD, many_outliers
from gpvo.front_end import FEW_INLIERS
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate

LENGTH = 0.05
"""Duration of a cluster, seconds."""


def clusters(duration: float, tracklets: int, inliers: int) -> list[ClusterReport]:
    """Make clusters that follow each other."""
    counts = {"observations": 0, "out_of_bounds": 0, "too_short": 0, "measurements": 0}
    one = ClusterReport(
        start=0.0,
        stop=LENGTH,
        left_events=1000,
        right_events=1000,
        left_out=(0, 0),
        noise_rate=0.0,
        flash=0.0,
        between=0,
        tracking=None,
        tracklets=tracklets,
        inliers=inliers,
        **counts,
    )
    number = round(duration / LENGTH)
    return [replace(one, start=k * LENGTH, stop=(k + 1) * LENGTH) for k in range(number)]


@pytest.mark.parametrize(
    ("duration", "tracklets", "inliers", "said"),
    [
        (1.5, 100, 75, True),
        (1.5, 100, 85, False),
        (0.9 * PERIOD, 100, 75, False),
        (1.5, round(ENOUGH * LENGTH / PERIOD) - 1, FEW_INLIERS, False),
        (1.5, 100, FEW_INLIERS, True),
        (1.5, 100, FEW_INLIERS - 1, False),  # hardly a velocity: that is said otherwise
    ],
)
def test_a_share_of_a_second_is_told(
    duration: float, tracklets: int, inliers: int, said: bool
) -> None:
    faults = list(many_outliers(clusters(duration, tracklets, inliers)))
    assert len(faults) == said
    if said:
        assert faults[0].harms and f"{100 - inliers}% of the landmarks" in faults[0].line
        assert faults[0].t == pytest.approx(duration - PERIOD)


def test_what_was_before_the_last_second_does_not_count() -> None:
    before, after = clusters(1.0, 100, 50), clusters(1.2, 100, 95)
    later = [replace(one, start=one.start + 1.0, stop=one.stop + 1.0) for one in after]
    assert list(many_outliers(before + later[:5]))
    assert not list(many_outliers(before + later))


def test_few_landmarks_move_otherwise_where_nothing_moves_by_itself() -> None:
    config = SimulationConfig(seed=4, duration=1.3, resolution=(160, 120), focal_length=104.0)
    recording: SimulatedRecording = simulate(config)
    odometry = Odometry(recording.rig)
    odometry.run(recording)
    outliers = 1 - sum(r.inliers for r in odometry.reports) / sum(
        r.tracklets for r in odometry.reports if r.inliers
    )
    assert outliers < 0.5 * MANY and not odometry.faults
