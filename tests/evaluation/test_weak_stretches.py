"""Weak stretches: where states are few, and where there are none."""

import numpy as np

from gpvo.evaluation.poses.continuous import ContinuousPoses
from gpvo.evaluation.report.weak_stretches import weak_stretches
from gpvo.trajectory import Trajectory

START_NS = 5_000_000_000


def trajectory_with_states_at(t: np.ndarray) -> Trajectory:
    poses = np.tile(np.eye(4), (len(t), 1, 1))
    joint = np.eye(24)[None]
    return Trajectory(
        START_NS, t, poses, np.zeros((len(t), 6)), np.ones(6), np.arange(2), joint, np.ones(2)
    )


def test_few_and_no_states_are_told_apart():
    dense = np.arange(0.0, 3.0, 0.005)
    thinned = (dense > 1.0) & (dense < 1.2)
    t = dense[(~thinned | (np.arange(len(dense)) % 10 == 0)) & ~((dense >= 2.0) & (dense < 2.25))]
    few, none = weak_stretches(trajectory_with_states_at(t))
    assert (few.label, none.label) == ("few measurements", "motion prior alone")
    ends = np.array([few.start_ns, few.stop_ns, none.start_ns, none.stop_ns]) - START_NS
    np.testing.assert_allclose(ends * 1e-9, [1.0, 1.2, 2.0, 2.25], atol=0.006)


def test_even_states_are_not_weak():
    for step in (0.001, 0.02, 0.1):
        assert weak_stretches(trajectory_with_states_at(np.arange(0.0, 2.0, step))) == []


def test_a_stretch_moves_with_the_clock():
    poses = ContinuousPoses.of(trajectory_with_states_at(np.array([0.0, 0.05, 0.6, 0.65])))
    (gap,), (moved,) = (weak_stretches(one.trajectory) for one in (poses, poses.later(1000)))
    assert (moved.start_ns - gap.start_ns, moved.stop_ns - gap.stop_ns) == (1000, 1000)
