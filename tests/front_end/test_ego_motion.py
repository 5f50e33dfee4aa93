"""The motion between two frames, and the warp of the image around a landmark by it."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from factors import StereoCamera
from factors.lie import se3_exp
from gpvo.tracking.ego_motion import LARGEST, EgoMotion, camera_of_pixels, warp

CAMERA = StereoCamera(200.0, 210.0, 160.0, 120.0, 0.1)
seeds = st.integers(0, 2**32)


def test_motion_is_the_product_of_its_steps() -> None:
    motion, velocity = EgoMotion(), np.array([0.1, -0.2, 0.3, 1.0, 2.0, -3.0])
    motion.advance(5.0)
    np.testing.assert_array_equal(motion.T_start_cam, np.eye(4))
    motion.velocity = velocity
    motion.advance(5.1)
    motion.velocity = -velocity
    motion.advance(5.3)
    expected = se3_exp(0.1 * velocity) @ se3_exp(-0.2 * velocity)
    np.testing.assert_allclose(motion.T_start_cam, expected, atol=1e-15)


@given(seeds, st.sampled_from([1, 2]))
@settings(deadline=None, max_examples=50)
def test_a_warp_is_the_jacobian_of_the_new_pixel(seed: int, side: int) -> None:
    rng, camera = np.random.default_rng(seed), camera_of_pixels(CAMERA, side)
    T = se3_exp(rng.normal(0, [0.1, 0.1, 0.5, 0.1, 0.1, 0.1], (5, 6)))
    pixels, disparity = rng.uniform([20, 20], [140, 100], (5, 2)), rng.uniform(8, 20, 5)

    def seen(moved: np.ndarray) -> np.ndarray:
        """Project points at the depth of the landmarks, as the fronto-parallel surface has."""
        points = camera.triangulate(np.column_stack([pixels + moved, disparity]))
        now = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
        return camera.project(now)[:, :2]

    step = 1e-5
    numerical = np.stack(
        [(seen(step * axis) - seen(-step * axis)) / (2 * step) for axis in np.eye(2)], axis=2
    )
    np.testing.assert_allclose(warp(camera, T, pixels, disparity), numerical, atol=1e-6)


def test_pixels_of_half_the_resolution_see_the_same_rays() -> None:
    point = np.array([[0.3, -0.2, 2.0]])
    whole, half = CAMERA.project(point), camera_of_pixels(CAMERA, 2).project(point)
    np.testing.assert_allclose(whole[:, :2], 2 * half[:, :2] + 0.5)
    np.testing.assert_allclose(whole[:, 2], 2 * half[:, 2])


def test_what_cannot_be_warped_is_left_as_it_is() -> None:
    """The landmark, 2 m ahead, is passed, almost reached, and left far behind."""
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, 2, 3] = -3.0, -1.999, 2.0 * LARGEST
    pixels = np.full((3, 2), 100.0)
    warps = warp(CAMERA, T, pixels, np.full(3, 200.0 * 0.1 / 2.0))
    np.testing.assert_array_equal(warps, np.tile(np.eye(2), (3, 1, 1)))
