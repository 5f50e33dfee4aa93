"""The motion between two frames, and cameras of larger pixels."""

from __future__ import annotations

import numpy as np

from factors import StereoCamera
from factors.lie import se3_exp
from gpvo.tracking.ego_motion import ALONE, EgoMotion, camera_of_pixels

CAMERA = StereoCamera(200.0, 210.0, 160.0, 120.0, 0.1)


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


def test_a_pose_that_was_found_anew_holds_until_the_estimator_may_know_it() -> None:
    motion, known, anew = EgoMotion(), se3_exp(np.full(6, 0.1)), se3_exp(np.full(6, 0.2))
    motion.advance(0.0)
    motion.relocate(anew)
    for frame in range(1, ALONE):
        motion.restart(frame - 1.0, known)
        motion.advance(float(frame))
        np.testing.assert_array_equal(motion.T_start_cam, anew)
    motion.advance(float(ALONE))
    motion.restart(float(ALONE), known)
    np.testing.assert_array_equal(motion.T_start_cam, known)


def test_pixels_of_half_the_resolution_see_the_same_rays() -> None:
    point = np.array([[0.3, -0.2, 2.0]])
    whole, half = CAMERA.project(point), camera_of_pixels(CAMERA, 2).project(point)
    np.testing.assert_allclose(whole[:, :2], 2 * half[:, :2] + 0.5)
    np.testing.assert_allclose(whole[:, 2], 2 * half[:, 2])
