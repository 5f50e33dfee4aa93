"""The map of a simulated recording lies on the true surface, as closely as it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from factors import StereoCamera
from gpvo.errors import InputError
from gpvo.mapping import LandmarkMap, triangulate
from gpvo.mapping.landmark_map import PLY_TYPE
from gpvo.mapping.surface_error import surface_distance
from gpvo.tracking import Measurements
from gpvo.trajectory import Trajectory

CAMERA = StereoCamera(200.0, 200.0, 120.0, 90.0, 0.1)
INFORMATION = (4.0, 4.0, 9.0)


def straight(speed: float = 0.5) -> Trajectory:
    """Make a motion to the right for a second."""
    t, T = np.linspace(0, 1, 11), np.tile(np.eye(4), (11, 1, 1))
    T[:, 0, 3] = speed * t
    twist = np.tile([0.0, 0, 0, speed, 0, 0], (11, 1))
    joint = np.tile(1e-8 * np.eye(24), (10, 1, 1))
    return Trajectory(0, t, T, twist, np.ones(6), np.arange(11), joint, np.ones(11))


def measured(points: np.ndarray, rng: np.random.Generator, noise: float) -> Measurements:
    """Measure each point 20 times."""
    landmark = np.repeat(np.arange(len(points)), 20)
    t = np.sort(rng.uniform(0, 1, (len(points), 20)), axis=1).ravel()
    seen = points[landmark] - np.column_stack([0.5 * t, 0 * t, 0 * t])
    stereo = CAMERA.project(seen) + noise * rng.standard_normal(seen.shape) / np.sqrt(INFORMATION)
    return Measurements(landmark, np.zeros(len(t), np.int64), t, stereo)


def room(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform([-1, -1, 1], [1, 1, 4], (count, 3))


def test_points_are_found_again() -> None:
    rng = np.random.default_rng(0)
    points = room(rng, 50)
    found = triangulate(straight(), measured(points, rng, 0.0), CAMERA, INFORMATION)
    assert found.landmark.tolist() == list(range(50))
    np.testing.assert_allclose(found.position, points, atol=1e-9)
    np.testing.assert_allclose(found.depth, points[:, 2], atol=1e-9)
    assert (found.measurements == 20).all() and (found.first_time < found.last_time).all()


def test_errors_are_as_large_as_the_covariance_says() -> None:
    rng = np.random.default_rng(1)
    points = room(rng, 400)
    found = triangulate(straight(), measured(points, rng, 1.0), CAMERA, INFORMATION)
    error = found.position - points[found.landmark]
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error)
    assert len(found) > 350
    assert np.mean(squared) == pytest.approx(3.0, abs=0.5)


def test_what_is_no_point_or_was_hardly_seen_is_left_out() -> None:
    rng = np.random.default_rng(2)
    points = room(rng, 4)
    all_seen = measured(points, rng, 0.3)
    few = np.flatnonzero(all_seen.landmark == 1)[3:]
    seen = all_seen[np.setdiff1d(np.arange(len(all_seen)), few)]
    seen.stereo[seen.landmark == 2, 0] += rng.uniform(-20, 20, 20)
    found = triangulate(straight(), seen, CAMERA, INFORMATION)
    assert found.landmark.tolist() == [0, 3]


def test_landmarks_that_run_away_to_where_nothing_is_measured_are_left_out() -> None:
    """The measurements of 100 far ones contradict each other; a right one beside them stays."""
    rng = np.random.default_rng(4)
    right, landmark = measured(room(rng, 1), rng, 0.3), np.repeat(np.arange(1, 101), 4)
    stereo = rng.uniform([0, 0, 0.01], [240, 180, 2], (len(landmark), 3))
    t = rng.uniform(0, 1, len(landmark))
    wrong = Measurements(landmark, np.zeros(len(landmark), np.int64), t, stereo)
    seen = Measurements.concatenate([right, wrong])
    found = triangulate(straight(), seen, CAMERA, INFORMATION)
    alone = triangulate(straight(), right, CAMERA, INFORMATION)
    assert found.landmark.tolist() == alone.landmark.tolist() == [0]
    np.testing.assert_array_equal(found.position, alone.position)


def test_no_measurements_are_an_empty_map() -> None:
    assert len(triangulate(straight(), Measurements.concatenate([]), CAMERA, INFORMATION)) == 0


def test_files_hold_the_map(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    found = triangulate(straight(), measured(room(rng, 30), rng, 1.0), CAMERA, INFORMATION)
    found.save(tmp_path / "map.npz")
    again = LandmarkMap.load(tmp_path / "map.npz")
    for name in ("landmark", "position", "covariance", "measurements", "last_time", "depth"):
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))

    found.write_ply(tmp_path / "map.ply")
    head, rows = (tmp_path / "map.ply").read_bytes().split(b"end_header\n")
    assert head.startswith(b"ply\nformat binary_little_endian 1.0\nelement vertex 30\n")
    assert b"property float x\n" in head and b"property uchar red\n" in head
    table = np.frombuffer(rows, PLY_TYPE)
    np.testing.assert_allclose(table["z"], found.position[:, 2], rtol=1e-6)
    np.testing.assert_array_equal(table["measurements"], found.measurements)

    (tmp_path / "bad.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"bad\.npz: is not a map"):
        LandmarkMap.load(tmp_path / "bad.npz")


def test_distance_from_boxes() -> None:
    boxes = np.array([[[0, 0, 0], [10, 10, 10]], [[4, 4, 4], [6, 6, 6]]], np.float64)
    points = np.array([[1, 5, 5], [5, 5, 5], [3, 5, 5], [-2, 5, 5], [7, 7, 5]], np.float64)
    expected = [1.0, 1.0, 1.0, 2.0, np.sqrt(2)]
    np.testing.assert_allclose(surface_distance(points, boxes), expected)
