"""Motions: the twist is the derivative of the pose, and the camera stays in the clear part."""

from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gpvo.simulation import SimulationConfig
from gpvo.simulation.motion import Motion, MotionName

NAMES = get_args(MotionName)
seeds = st.integers(0, 2**32)


def random_motion(name: MotionName, seed: int, duration: float = 6.0) -> Motion:
    return Motion.random(name, duration, np.random.default_rng(seed))


@given(st.sampled_from(NAMES), seeds, st.floats(0.01, 5.9))
@settings(deadline=None, max_examples=60)
def test_twist_is_the_derivative_of_the_pose(name: MotionName, seed: int, t: float) -> None:
    motion, h = random_motion(name, seed), 1e-4
    before, now, after = motion.pose([t - h, t, t + h])
    turn = Rotation.from_matrix(before[:3, :3].T @ after[:3, :3]).as_rotvec()
    step = now[:3, :3].T @ (after[:3, 3] - before[:3, 3])
    numerical = np.concatenate([turn, step]) / (2 * h)
    np.testing.assert_allclose(motion.twist(t)[0], numerical, atol=1e-5)


@given(st.sampled_from(NAMES), seeds, st.floats(0.5, 20.0))
@settings(deadline=None, max_examples=60)
def test_camera_stays_in_the_clear_part_of_the_room(
    name: MotionName, seed: int, duration: float
) -> None:
    config = SimulationConfig(motion=name, duration=duration)
    room, clear = config.room
    poses = random_motion(name, seed, duration).pose(np.linspace(0.0, duration, 500))
    right = poses[:, :3, 3] + config.baseline * poses[:, :3, 0]
    for positions in (poses[:, :3, 3], right):
        assert (positions > clear[0]).all() and (positions < clear[1]).all()
    assert (room[0] < clear[0]).all() and (clear[1] < room[1]).all()


def test_named_motions_are_what_their_names_say() -> None:
    t = np.linspace(0.0, 6.0, 600)
    twists = {name: random_motion(name, 1).twist(t) for name in NAMES}
    assert not twists["still"].any()
    assert np.abs(twists["rotation"][:, 3:]).max() < 1e-12
    assert np.linalg.norm(twists["hand_held"][:, 3:], axis=1).mean() == pytest.approx(0.5, abs=0.2)
    speed = {name: np.linalg.norm(twist, axis=1).mean() for name, twist in twists.items()}
    assert speed["fast"] > 1.5 * speed["hand_held"]
    ends = random_motion("corridor", 1).pose([0.0, 6.0])[:, 0, 3]
    assert ends[1] - ends[0] == pytest.approx(0.7 * 6.0)
    sideways = random_motion("back_and_forth", 1).twist(t)[:, 3]
    assert np.count_nonzero(np.diff(np.sign(sideways))) >= 4


def test_later_shifts_the_time() -> None:
    motion = random_motion("hand_held", 3)
    np.testing.assert_array_equal(motion.later(0.25).pose(1.0), motion.pose(1.25))
    np.testing.assert_array_equal(motion.later(0.25).twist(1.0), motion.twist(1.25))
