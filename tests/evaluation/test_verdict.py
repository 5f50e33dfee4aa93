"""Verdict on runs whose inliers are given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpvo.cluster_report import ClusterReport
from gpvo.faults import Fault
from gpvo.front_end import FEW_INLIERS
from gpvo.tracking import TrackingReport
from gpvo.trajectory import Trajectory
from gpvo.verdict import MOSTLY, verdict

PERIOD = 0.05
REPORT = ClusterReport(
    start=0.0,
    stop=PERIOD,
    left_events=20_000,
    right_events=20_000,
    left_out=(0, 0),
    noise_rate=0.0,
    flash=0.0,
    between=0,
    tracking=None,
    observations=200,
    out_of_bounds=0,
    too_short=0,
    tracklets=200,
    inliers=0,
    measurements=0,
)


def reports(inliers: list[int]) -> list[ClusterReport]:
    """Make reports of consecutive clusters."""
    return [
        replace(REPORT, start=PERIOD * k, stop=PERIOD * (k + 1), inliers=count)
        for k, count in enumerate(inliers)
    ]


@given(st.lists(st.integers(FEW_INLIERS, 300), min_size=1, max_size=50))
def test_measured_throughout_is_good(inliers: list[int]) -> None:
    found = verdict(reports(inliers))
    assert (found.word, found.reasons, found.dead_reckoning) == ("good", (), 0.0)


@given(st.lists(st.integers(0, 2 * FEW_INLIERS), min_size=1, max_size=50))
def test_dead_reckoning_is_the_share_of_the_clusters_with_few_inliers(inliers: list[int]) -> None:
    found = verdict(reports(inliers))
    share = sum(count < FEW_INLIERS for count in inliers) / len(inliers)
    assert found.dead_reckoning == pytest.approx(share)
    assert (found.word == "failed") == (found.dead_reckoning >= MOSTLY)
    assert sum(one.duration for one in found.stretches) == pytest.approx(
        share * PERIOD * len(inliers)
    )


def test_a_first_cluster_without_inliers_is_no_fault() -> None:
    assert verdict(reports([0, 0] + [150] * 60)).word == "good"


@pytest.mark.parametrize(("count", "word"), [(4, "good"), (11, "degraded")])
def test_the_first_landmarks_are_those_of_the_first_motion(count: int, word: str) -> None:
    """A camera at rest shows none."""
    still = TrackingReport(0, 0, 0, 0, at_rest=True)
    resting = [replace(one, tracking=still) for one in reports([0] * 20)]
    began = [
        replace(one, start=one.start + 1.0, stop=one.stop + 1.0)
        for one in reports([0] * count + [150] * 20)
    ]
    found = verdict(resting + began)
    assert found.word == word and verdict(began).word == word
    assert found.reasons == verdict(began).reasons


@pytest.mark.parametrize(
    ("inliers", "seen"),
    [
        ([0] * 12 + [150] * 60, "first landmarks were found after 0.60 s"),
        ([150] * 20 + [2] * 8 + [150] * 40, "more than 0.25 s: 1.00 to 1.40 s"),
        (([150] * 9 + [0]) * 10, "10 % of the time is dead reckoning"),
    ],
)
def test_what_was_seen_is_said(inliers: list[int], seen: str) -> None:
    found = verdict(reports(inliers))
    assert found.word == "degraded" and len(found.reasons) == 1 and seen in found.reasons[0]


def test_mostly_without_inliers_is_failed() -> None:
    """Twenty-five of 29 clusters of a rig that stood still."""
    found = verdict(reports([12] * 4 + [0] * 25))
    assert found.word == "failed" and "86 % of the time" in found.reasons[0]


def test_what_harms_the_events_degrades_and_what_does_not_is_kept() -> None:
    harmless = Fault("hot pixels", 0.1, "mask them", harms=False)
    assert verdict(reports([150] * 60), [harmless]).word == "good"
    found = verdict(reports([150] * 60), [harmless, Fault("clocks apart", 1.5, "synchronise")])
    assert (found.word, found.reasons) == ("degraded", ("clocks apart from 1.50 s on",))
    assert [fault["kind"] for fault in found.to_dict()["faults"]] == ["hot pixels", "clocks apart"]


def test_a_fault_that_the_covariance_does_not_know_fails_a_run() -> None:
    apart = Fault("clocks apart", 1.5, "synchronise", numbers={"offset_s": 0.05}, fails=True)
    found = verdict(reports([150] * 60), [apart])
    assert found.word == "failed" and found.reasons[0].startswith(
        "clocks apart: wrong by more than"
    )
    (told,) = found.to_dict()["faults"]
    assert told["numbers"] == {"offset_s": 0.05}


def test_rest_is_no_dead_reckoning() -> None:
    still = TrackingReport(0, 0, 9, 9, at_rest=True)
    rest = [replace(one, tracking=still) for one in reports([0] * 60)]
    assert verdict(rest).word == "good"


@pytest.mark.parametrize(("stop", "word"), [(0.0, "failed"), (1.0, "failed"), (2.9, "good")])
def test_a_trajectory_that_ends_before_the_measurements_is_failed(stop: float, word: str) -> None:
    poses = np.tile(np.eye(4), (2, 1, 1))
    nothing = np.empty(0)
    path = Trajectory(
        0, np.array([0.0, stop]), poses, np.zeros((2, 6)), np.ones(6), nothing, nothing, nothing
    )
    measured = [replace(one, measurements=90) for one in reports([150] * 60)]
    found = verdict(measured, trajectory=path)
    assert found.word == word
    assert word == "good" or found.reasons[0].startswith(f"the trajectory ends at {stop:.2f} s")
