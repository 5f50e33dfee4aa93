"""Odometry and inspection share one front end, and any object can be the tracker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import PurePosixPath

import numpy as np
import pytest

from gpvo import InputError, LiveOdometry, Odometry
from gpvo.config import Configuration
from gpvo.evaluation.front_end.inspect import inspect
from gpvo.evaluation.front_end.truth import truth_of_simulation
from gpvo.events import StereoCluster
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate
from gpvo.tracking import MultiResolutionTracker, Observations

FEW = Configuration.model_validate({"tracking": {"klt": {"max_features": 40}}})


@pytest.fixture(scope="module")
def recording() -> SimulatedRecording:
    return simulate(
        SimulationConfig(
            seed=3, motion="fast", duration=0.25, resolution=(160, 120), focal_length=100.0
        )
    )


def test_inspection_sees_what_the_odometry_does(recording: SimulatedRecording) -> None:
    odometry = Odometry(recording.rig, FEW)
    odometry.run(recording)
    seen = inspect(recording, truth_of_simulation(recording), FEW)
    assert sum(report.inliers for report in odometry.reports) > 20
    reports = odometry.reports
    assert [(c.start, c.stop) for c in seen] == [(r.start, r.stop) for r in reports]
    # Observations of the first cluster come with those of the second, which tells their lag.
    features, added = [c.features for c in seen], [r.observations for r in reports]
    assert features[0] == added[0] == 0 and features[1] > 20
    # What is found in a cluster is reported with the next one.
    followed = [r.tracking.closed for r in reports]
    found = np.subtract(features, followed)
    assert (found >= 0).all() and found[1:].any()
    np.testing.assert_array_equal(added[2:], np.add(followed[2:], found[1:-1]))
    assert [(len(c.tracklets), c.tracklets.accepted.sum()) for c in seen] == [
        (r.tracklets, r.inliers) for r in odometry.reports
    ]


@pytest.mark.parametrize("make", [Odometry, LiveOdometry])
def test_paths_are_no_rig_and_no_configuration(
    make: Callable[..., object], recording: SimulatedRecording
) -> None:
    with pytest.raises(InputError, match=r"rig: must be a StereoRig, not str; use read_cal"):
        make("camchain.yaml")
    with pytest.raises(InputError, match="must be a Configuration, not PurePosixPath"):
        make(recording.rig, PurePosixPath("config.yaml"))


class Wrapped:
    """Tracker of a user that wraps the configured one and records the clusters it is given.

    Its report is of another kind than those of the package.
    """

    report = "all is well"

    def __init__(self, usual: Odometry) -> None:
        self.clusters: list[StereoCluster] = []
        self._tracker = MultiResolutionTracker(usual.configuration.tracking, usual.camera)
        self.motion = self._tracker.motion

    def track(self, cluster: StereoCluster) -> Observations:
        self.clusters.append(cluster)
        return self._tracker.track(cluster)


def test_any_object_may_be_the_tracker(recording: SimulatedRecording) -> None:
    usual = Odometry(recording.rig, FEW)
    mine = Wrapped(usual)
    own = Odometry(recording.rig, FEW, tracker=mine)
    poses = [each.run(recording).pose(np.linspace(0.15, 0.2, 5)) for each in (own, usual)]
    assert len(mine.clusters) == len(own.reports)
    # What this one finds comes at once, instead of with the next cluster.
    reports = [
        [replace(report, tracking=None, observations=0) for report in each.reports]
        for each in (own, usual)
    ]
    assert reports[0] == reports[1]
    assert all(report.tracking is not None for report in usual.reports)
    np.testing.assert_array_equal(*poses)


def test_a_run_ends_within_hours_without_events(recording: SimulatedRecording) -> None:
    """They are one batch of thousands of clusters; Ctrl-C waited for all of them."""
    silent, odometry = replace(recording, duration=7200.0), Odometry(recording.rig, FEW)
    trajectory = odometry.run(silent, ended=lambda: odometry.tracked_until > 1.0)
    assert 0.8 < odometry.reports[-1].stop == odometry.tracked_until < 2.0
    assert trajectory.stop == odometry.reports[-1].stop
