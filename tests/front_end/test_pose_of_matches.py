"""A pose from matches of which most are wrong."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_exp, se3_inverse, se3_log
from gpvo.tracking.pose_of_matches import LEAST, _rigid_triples, pose_of_matches

Array = NDArray[np.float64]

CAMERA = StereoCamera(200.0, 200.0, 160.0, 120.0, 0.1)
T_START_CAM = se3_exp([0.3, -0.5, 0.2, 0.6, -0.2, 0.4])


def matches(right: int, wrong: int, seed: int) -> tuple[Array, Array]:
    """Points (N, 3) and where they are measured (N, 3), within 0.3 pixels; wrong ones anywhere."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(10, 310, right + wrong), rng.uniform(10, 230, right + wrong)
    measured = np.column_stack([u, v, rng.uniform(3, 20, right + wrong)])
    points = CAMERA.triangulate(measured) @ T_START_CAM[:3, :3].T + T_START_CAM[:3, 3]
    points[right:] = rng.permutation(points[right:])
    return points, measured + rng.uniform(-0.3, 0.3, measured.shape)


@pytest.mark.parametrize("seed", range(10))
def test_a_pose_is_found_though_one_in_twenty_matches_is_right(seed: int) -> None:
    """Of random triples one in 8000 is right, so that 4000 of them would hardly do."""
    points, measured = matches(12, 228, seed)
    T = pose_of_matches(CAMERA, points, measured)
    assert T is not None
    error = se3_log(se3_inverse(T) @ T_START_CAM)
    assert np.linalg.norm(error[:3]) < 0.02 and np.linalg.norm(error[3:]) < 0.05


@pytest.mark.parametrize("seed", range(5))
def test_wrong_matches_have_no_pose(seed: int) -> None:
    assert pose_of_matches(CAMERA, *matches(0, 240, seed)) is None


def test_as_many_matches_as_asked_have_to_agree() -> None:
    points, measured = matches(LEAST - 2, 0, 1)
    assert pose_of_matches(CAMERA, points, measured) is None
    assert pose_of_matches(CAMERA, points, measured, LEAST - 2) is not None
    assert pose_of_matches(CAMERA, points[:2], measured[:2], 2) is None


def test_the_corners_of_a_triple_are_as_far_apart_as_they_are_seen() -> None:
    points, measured = matches(30, 200, 2)
    seen = CAMERA.triangulate(measured)
    triples = _rigid_triples(CAMERA, points, seen)
    assert len(triples) > 100
    z = seen[:, 2]
    deviation = np.hypot(z**2 / (CAMERA.fx * CAMERA.baseline), z / CAMERA.fx)
    for i, j in ((0, 1), (1, 2), (0, 2)):
        a, b = triples[:, i], triples[:, j]
        known = np.linalg.norm(points[a] - points[b], axis=1)
        measured_apart = np.linalg.norm(seen[a] - seen[b], axis=1)
        assert (known > 0).all()
        assert (np.abs(known - measured_apart) < np.hypot(deviation[a], deviation[b])).all()
