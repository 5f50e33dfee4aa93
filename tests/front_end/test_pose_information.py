"""New features are chosen by what they tell of the pose while they are in view."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from front_end_scenes import track
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_exp, se3_inverse
from gpvo.config import TrackingConfig
from gpvo.tracking.klt import KltTracker
from gpvo.tracking.klt.frame import Frame
from gpvo.tracking.klt.new_landmarks import NewLandmarks
from gpvo.tracking.klt.pose_information import (
    HORIZON,
    frames_in_view,
    most_telling,
    whitened_jacobians,
)

CAMERA = StereoCamera(200.0, 210.0, 160.0, 120.0, 0.1)
SHAPE = HEIGHT, WIDTH = 240, 320
STILL = np.eye(4)
seeds = st.integers(0, 2**32)


def measurements(count: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform([10, 10, 4], [WIDTH - 10, HEIGHT - 10, 30], (count, 3))


@given(seeds)
@settings(deadline=None, max_examples=50)
def test_rows_are_the_jacobian_of_all_frames(seed: int) -> None:
    rng = np.random.default_rng(seed)
    measured = measurements(7, rng)
    points, step = CAMERA.triangulate(measured), 1e-6

    def seen(twist: np.ndarray) -> np.ndarray:
        """Project the points into a camera that moved."""
        T = se3_inverse(se3_exp(twist))
        return CAMERA.project(points @ T[:3, :3].T + T[:3, 3])

    moved = step * np.eye(6)
    numerical = np.stack([(seen(m) - seen(-m)) / (2 * step) for m in moved], axis=2)
    rows = whitened_jacobians(CAMERA, STILL, SHAPE, measured)
    expected = np.sqrt(HORIZON) * numerical
    np.testing.assert_allclose(rows, expected, rtol=1e-5, atol=1e-4 * np.abs(expected).max())


@given(seeds)
@settings(deadline=None, max_examples=50)
def test_frames_in_view_are_those_until_the_motion_takes_it_out(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = CAMERA.triangulate(measurements(30, rng))
    T = se3_exp(rng.normal(0, [0.02, 0.02, 0.02, 0.05, 0.05, 0.3]))
    expected = np.zeros(30, int)
    for i, point in enumerate(points):
        now = point
        while expected[i] < HORIZON and now[2] > 0:
            u, v, _ = CAMERA.project(now)
            if not (0 <= u < WIDTH and 0 <= v < HEIGHT):
                break
            expected[i] += 1
            now = se3_inverse(T)[:3] @ np.append(now, 1.0)
    np.testing.assert_array_equal(frames_in_view(CAMERA, T, SHAPE, points), expected)


@given(seeds, st.integers(0, 5), st.integers(0, 8))
@settings(deadline=None, max_examples=50)
def test_each_next_one_makes_the_determinant_of_the_covariance_least(
    seed: int, known: int, count: int
) -> None:
    rows = np.random.default_rng(seed).normal(0, 3.0, (known + 8, 3, 6))
    information = np.eye(6) + sum(row.T @ row for row in rows[:known])
    left, expected = list(range(known, known + 8)), np.zeros(8, bool)
    for _ in range(count):
        told = [np.linalg.slogdet(information + rows[i].T @ rows[i])[1] for i in left]
        best = left.pop(int(np.argmax(told)))
        information = information + rows[best].T @ rows[best]
        expected[best - known] = True
    np.testing.assert_array_equal(most_telling(rows, known, count), expected)


def test_what_leaves_the_image_soon_tells_less() -> None:
    """Two alike at the right and the left border; the camera moves to the left."""
    measured = np.array([[300.0, 120.0, 20.0], [20.0, 120.0, 20.0]])
    T = STILL.copy()
    T[0, 3] = -0.02
    rows = whitened_jacobians(CAMERA, T, SHAPE, measured)
    np.testing.assert_array_equal(most_telling(rows, 0, 1), [False, True])


@pytest.mark.parametrize("candidates", [1.0, 3.0])
def test_they_are_chosen_from_so_many_as_are_configured(
    candidates: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A view that slides sideways: new features come at its border, near and far."""
    counts, in_stereo = [], NewLandmarks.in_stereo

    def counted(self: NewLandmarks, left: NDArray[np.float32], frame: Frame) -> Frame:
        counts.append((len(left), tracker.allowed.room(frame)))
        return in_stereo(self, left, frame)

    monkeypatch.setattr(NewLandmarks, "in_stereo", counted)
    noise = np.random.default_rng(3).normal(0, 1, (HEIGHT, 600))
    plane = cv2.GaussianBlur(noise, (0, 0), 2.0)
    image = np.clip(127 + 45 * plane / plane.std(), 0, 255).astype(np.uint8)
    klt = {"min_row_gradient": 0, "max_features": 60, "candidates": candidates}
    tracker = KltTracker(TrackingConfig.model_validate({"klt": klt}), CAMERA)
    for column in range(0, 120, 6):
        tracker.T_start_cam = STILL.copy()
        tracker.T_start_cam[0, 3] = column * CAMERA.baseline / 8
        views = (image[:, start : start + WIDTH] for start in (column, column + 8))
        seen = track(tracker, *map(np.ascontiguousarray, views))
        assert len(np.unique(seen.landmark)) == len(seen.landmark) <= 60
    (first, _), *later = counts
    assert first == 60, "the first ones are the strongest, as nothing moved yet"
    assert all(found <= candidates * room for found, room in later)
    assert max(found / room for found, room in later if room > 0) == candidates
