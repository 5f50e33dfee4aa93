"""A trajectory begins where enough landmarks hold it, and nothing after that is lost."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from gpvo import Odometry
from gpvo.config import Configuration
from gpvo.estimator.beginning import PATIENCE, Beginning
from gpvo.simulation import SimulationConfig, simulate
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory import Trajectory

PERIOD = 0.1
"""Time between clusters, seconds."""
COUNTS = st.lists(st.integers(0, 30), min_size=1, max_size=12)


def measured(frame: int, count: int) -> Measurements:
    """Measurements of so many landmarks in a cluster."""
    landmark = 100 * frame + np.arange(count)
    t = np.full(count, frame * PERIOD)
    return Measurements(landmark, np.full(count, frame), t, np.ones((count, 3)))


def frames_taken(counts: list[int], least: int) -> list[list[int]]:
    """Numbers of the clusters of what each call returns, and the call at the end."""
    beginning = Beginning(least)
    given = [
        beginning.add((frame + 1) * PERIOD, measured(frame, count))
        for frame, count in enumerate(counts)
    ]
    return [np.unique(each.frame).tolist() for each in [*given, beginning.end()]]


@given(COUNTS, st.integers(1, 20))
@example([5, 4, 3, 19, 30], 20)
def test_it_begins_at_the_first_cluster_with_enough_or_when_patience_ends(
    counts: list[int], least: int
) -> None:
    seen = [frame for frame, count in enumerate(counts) if count > 0]
    enough = [frame for frame, count in enumerate(counts) if count >= least]
    tired = [f for f in range(len(counts)) if seen and (f + 1 - seen[0]) * PERIOD >= PATIENCE]
    taken = frames_taken(counts, least)
    call = min([*enough[:1], *tired[:1]], default=len(counts))
    assert not any(taken[:call])
    first = enough[0] if enough and call == enough[0] else (seen or [0])[0]
    assert [frame for each in taken for frame in each] == [f for f in seen if f >= first]


@given(COUNTS)
def test_without_a_least_number_all_is_taken_at_once(counts: list[int]) -> None:
    assert frames_taken(counts, 0)[:-1] == [[f] if count else [] for f, count in enumerate(counts)]


def test_earlier_measurements_of_a_cluster_count_with_later_ones() -> None:
    """Tracklets that were too short at first give what they were measured at before."""
    beginning = Beginning(20)
    assert not len(beginning.add(0.1, measured(0, 12)))
    later = Measurements.concatenate([measured(0, 30)[12:], measured(1, 8)])
    assert len(beginning.add(0.2, later)) == 38


def run(start_landmarks: int) -> Trajectory:
    """A camera that sets out slowly, so that few contours have gathered at first."""
    slow = SimulationConfig(
        seed=16006, duration=0.8, resolution=(160, 120), focal_length=110.0, threshold=0.35
    )
    recording = simulate(slow)
    configuration = Configuration.model_validate(
        {"estimator": {"start_landmarks": start_landmarks}}
    )
    return Odometry(recording.rig, configuration).run(recording)


def test_a_run_begins_later_the_more_landmarks_it_begins_with() -> None:
    starts = [run(landmarks).start for landmarks in (0, 20, 80)]
    assert starts == sorted(starts)
    assert starts[-1] > starts[0]
