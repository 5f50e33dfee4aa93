"""A recording without inliers says at which stage they were lost, with the numbers seen there."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from gpvo import Odometry
from gpvo.cluster_report import ClusterReport
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.front_end import FEW_INLIERS
from gpvo.lost_stage import EARLY, FEW_LANDMARKS, is_lost, lost_stage
from gpvo.recordings import Events
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate
from gpvo.tracking import TrackingReport

SIZE = (160, 120)
GOOD = ClusterReport(
    start=0.0,
    stop=0.05,
    left_events=4001,
    right_events=3002,
    left_out=(103, 14),
    noise_rate=1.0,
    flash=0.0,
    between=0,
    tracking=TrackingReport(features=105, stereo=66, known=97, closed=88),
    observations=149,
    out_of_bounds=15,
    too_short=21,
    tracklets=72,
    inliers=0,
    measurements=0,
)
LOST = {
    "4 left and 3002 right events after 103 of background": {"left_events": 4},
    "4001 left and 0 right events": {"right_events": 0},
    "3 new features and 1 known": {"tracking": TrackingReport(3, 0, 1, 0)},
    "2 of the new ones matched": {"tracking": TrackingReport(105, 2, 97, 5)},
    "5 of the known ones followed": {"tracking": TrackingReport(105, 66, 97, 5)},
    "6 observations": {"tracking": None, "observations": 6},
    "140 of them with left and right events too far apart": {"out_of_bounds": 140},
    "121 tracklets too short and 2 long enough": {"too_short": 121, "tracklets": 2},
    "0 that agree on one velocity": {},
    "5 that agree on one velocity": {"inliers": FEW_INLIERS - 1},
}


@pytest.mark.parametrize("seen", LOST)
def test_the_first_stage_with_little_left_is_said_with_its_numbers(seen: str) -> None:
    message = lost_stage([replace(GOOD, **LOST[seen])] * 3)
    assert message.startswith("3 of 3 clusters of events have hardly any inliers")
    before, _, after = message.partition(seen)
    assert after and "\n" not in message
    # What is said afterwards is advice, and no later stage's number.
    assert not any(character.isdigit() for character in after.partition(";")[2]), message
    assert before.count(";") == 1


def test_numbers_are_medians_of_clusters_with_few_inliers_in_which_something_moves() -> None:
    other = replace(GOOD, inliers=FEW_INLIERS, left_events=10**6)
    still = replace(GOOD, left_events=0, tracking=TrackingReport(0, 0, 9, 9, at_rest=True))
    lost = [replace(GOOD, left_events=events) for events in (2000, 3000, 10**5)]
    assert "3 of 6 clusters" in lost_stage([other, *lost, still, other])
    assert "3000 left" in lost_stage([other, *lost, still, other])
    assert not is_lost([other, *lost, still, other])
    assert is_lost([other, *lost, still])
    assert not is_lost([still] * 5) and not is_lost([])
    assert "0 clusters" in lost_stage([])


def test_a_camera_at_rest_is_said_and_no_short_recording() -> None:
    still = replace(GOOD, tracking=TrackingReport(0, 0, 0, 0, at_rest=True))
    message = lost_stage([still] * 20)
    assert "in 20 of 20 clusters of events nothing moved" in message
    assert "long enough" not in message


@pytest.fixture(scope="module")
def room() -> SimulatedRecording:
    return simulate(SimulationConfig(seed=3, duration=0.5, resolution=SIZE, focal_length=100.0))


def noise(rate: float, duration: float, seed: int) -> Events:
    """Make events at random, more to the left: evenly spread they would be those of rest."""
    rng = np.random.default_rng(seed)
    count = rng.poisson(rate * SIZE[0] * SIZE[1] * duration)
    x, y = ((side * rng.random(count) ** 2).astype(np.uint16) for side in SIZE)
    return Events(x, y, np.sort(rng.uniform(0, duration, count)), rng.random(count) < 0.5)


def failure(recording: SimulatedRecording, **configuration: object) -> str:
    odometry = Odometry(recording.rig, Configuration.model_validate(configuration))
    with pytest.raises(InputError) as error:
        odometry.run(recording)
    assert str(error.value).startswith(f"{recording.path}: no landmark could be tracked: ")
    return str(error.value)


def test_left_and_right_swapped(room: SimulatedRecording) -> None:
    message = failure(replace(room, left=room.right, right=room.left))
    assert "of the new ones matched in the right picture; " in message
    assert "left and right swapped" in message


def test_clocks_apart(room: SimulatedRecording) -> None:
    late = replace(room.right, t=room.right.t + 0.25)
    message = failure(replace(room, right=late, duration=room.duration + 0.25))
    assert "of the new ones matched in the right picture; " in message
    assert "clocks apart" in message


def test_clocks_apart_by_less_with_the_papers_tracker(room: SimulatedRecording) -> None:
    """Features are matched along the row, but their events are not of the same time."""
    late = replace(room.right, t=room.right.t + 0.05)
    late_room = replace(room, right=late, duration=room.duration + 0.05)
    message = failure(late_room, preset="paper", clustering={"max_events": 4000})
    assert "with left and right events too far apart in time" in message
    assert "clocks apart" in message


def test_noise_alone(room: SimulatedRecording) -> None:
    message = failure(replace(room, left=noise(5, 0.5, 0), right=noise(5, 0.5, 1)))
    assert "of background activity" in message
    assert "of the new ones matched in the right picture; " in message


def test_a_handful_of_events(room: SimulatedRecording) -> None:
    few = replace(room, left=room.left[::200], right=room.right[::200])
    message = failure(few)
    assert "right events after " in message and "; more events are needed" in message


def test_every_cluster_of_another_place(room: SimulatedRecording) -> None:
    """There are stereo matches, but no quad closes."""
    config = SimulationConfig(duration=0.12, resolution=SIZE, focal_length=100.0)
    sides: tuple[list[Events], list[Events]] = ([], [])
    for seed in range(6):
        other = simulate(config.model_copy(update={"seed": seed}))
        for parts, events in zip(sides, (other.left, other.right), strict=True):
            part = events.between(0.0, 0.1)
            parts.append(replace(part, t=part.t + 0.1 * seed))
    left, right = (Events.concatenate(parts) for parts in sides)
    places = replace(room, left=left, right=right, duration=0.6)
    message = failure(places, clustering={"window": 0.1, "max_events": 10**6})
    assert "known ones followed from the cluster before; clusters must be alike" in message


def test_tracklets_that_are_too_short(room: SimulatedRecording) -> None:
    message = failure(room, tracklets={"min_length": 200})
    assert "and 0 long enough; landmarks must be seen longer" in message


def test_few_inliers_among_tracklets(room: SimulatedRecording) -> None:
    exact = {"pixel_threshold": 0, "disparity_tolerance": 0, "relative_threshold": 1e-6}
    message = failure(room, mc_ransac=exact)
    assert "long enough, 0 that agree on one velocity; " in message


def test_it_is_said_once_after_a_second(
    room: SimulatedRecording, caplog: pytest.LogCaptureFixture
) -> None:
    duration = EARLY + 0.5
    blank = replace(
        room, left=noise(2, duration, 0), right=noise(2, duration, 1), duration=duration
    )
    odometry = Odometry(blank.rig)
    said = []
    with caplog.at_level(logging.WARNING, logger="gpvo.faults"):
        for _ in odometry.reports_of(blank.event_batches()):
            said.append(len(caplog.messages))
    early = [report.stop - odometry.reports[0].start < EARLY for report in odometry.reports]
    assert said == [0 if before else 1 for before in early] and 1 in said
    assert caplog.messages[0].endswith(lost_stage(odometry.reports[: early.count(True) + 1]))
    assert [fault.kind for fault in odometry.faults] == ["lost"]


def test_nothing_is_said_of_a_good_recording(
    room: SimulatedRecording, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gpvo.faults.watch.EARLY", 0.3)
    odometry = Odometry(room.rig)
    odometry.run(room)
    assert not caplog.messages
    assert odometry.reports[-1].inliers > FEW_LANDMARKS
