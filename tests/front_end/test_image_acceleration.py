"""The image of no point ahead of the camera accelerates more than the camera's velocity says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factors import StereoCamera
from gpvo.tracking import ImageAcceleration
from gpvo.tracking.image_acceleration import APART, FORGOTTEN

CAMERA = StereoCamera(200.0, 200.0, 120.0, 90.0, 0.1)
twists = st.lists(st.floats(-3, 3), min_size=6, max_size=6).map(np.array)
depths = st.floats(0.5, 20)


def image_velocity(twist: np.ndarray, depth: float) -> np.ndarray:
    """Compute that of a point in the middle of the image: its own is -w x p - v."""
    point = np.array([0, 0, depth])
    motion = -np.cross(twist[:3], point) - twist[3:]
    return CAMERA.fx * motion[:2] / depth


def acceleration(before: np.ndarray, after: np.ndarray, dt: float, depth: float) -> float:
    known, disparity = ImageAcceleration(CAMERA), CAMERA.fx * CAMERA.baseline / depth
    assert known.value == np.inf
    known.follow(1.0, before, np.full(3, disparity))
    assert known.value == np.inf
    known.follow(1.0 + dt, after, np.full(3, disparity))
    return known.value


@given(twists, twists, st.floats(0.01, 1), depths)
def test_it_bounds_the_change_of_the_image_motion(
    before: np.ndarray, after: np.ndarray, dt: float, depth: float
) -> None:
    change = image_velocity(after, depth) - image_velocity(before, depth)
    bound = acceleration(before, after, dt, depth) * dt
    assert np.linalg.norm(change) <= bound * (1 + 1e-9) + 1e-9


@given(st.floats(-3, 3), st.booleans(), depths)
def test_it_is_reached_by_turning_and_by_shifting(rate: float, turns: bool, depth: float) -> None:
    after = rate * np.eye(6)[1 if turns else 3]
    change = image_velocity(after, depth) / 0.1
    expected = pytest.approx(float(np.linalg.norm(change)), rel=1e-6)
    assert acceleration(np.zeros(6), after, 0.1, depth) == expected


def test_landmarks_that_are_lost_leave_it() -> None:
    known = ImageAcceleration(CAMERA)
    for k in range(3):
        known.follow(0.1 * k, np.arange(6.0) * k, np.full(5, 10.0))
    before = known.value
    known.follow(0.3, np.zeros(6), np.empty(0))
    assert known.value == before


@given(st.integers(0, 2**32), st.floats(0.005, 0.02))
def test_velocities_that_are_compared_are_apart_in_time(seed: int, dt: float) -> None:
    """The newest is compared with the latest one that is that old."""
    known, rng = ImageAcceleration(CAMERA), np.random.default_rng(seed)
    t, rates = dt * np.arange(30), rng.normal(size=30)
    for now, rate in zip(t, rates, strict=True):
        known.follow(now, rate * np.eye(6)[1], np.full(5, 10.0))
    before = np.flatnonzero(t <= t[-1] - APART)[-1]
    expected = CAMERA.fx * abs(rates[-1] - rates[before]) / (t[-1] - t[before])
    assert known.value == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("waited", [0.9, 1.1])
def test_it_is_unknown_again_where_no_velocity_is_found_for_a_while(waited: float) -> None:
    known = ImageAcceleration(CAMERA)
    for k in range(3):
        known.follow(0.1 * k, np.arange(6.0) * k, np.full(5, 10.0))
    before = known.value
    known.wait(0.2 + waited * FORGOTTEN)
    assert known.value == (before if waited < 1 else np.inf)
    known.follow(0.5, np.zeros(6), np.full(5, 10.0))
    assert known.value < np.inf
