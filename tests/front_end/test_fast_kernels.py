"""Kernels of fast MC-RANSAC compared with SE(3) and linear least squares."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from factors.lie import se3_exp
from gpvo.mc_ransac.fast import random_samples
from gpvo.mc_ransac.fast_kernels import best_sample_velocity, sample_velocity
from gpvo.mc_ransac.moved_points import moved_points

Array = NDArray[np.float64]
seeds = st.integers(0, 2**32)
CAMERA = np.array([200.0, 210.0, 120.0, 90.0, 0.1])


def scene(seed: int, count: int) -> tuple[Array, Array, Array]:
    """Make points (N, 3) in front of the camera, their displacements and dt (N,)."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-2, -1, 2], [2, 1, 6], (count, 3))
    return points, rng.normal(0, 0.1, (count, 3)), rng.uniform(0.01, 0.3, count)


def paper_velocity(points: Array, displacements: Array, dt: Array) -> Array:
    """Solve the paper's normal equations in our convention: d = dt [p^, -1] v."""
    normal, right = np.zeros((6, 6)), np.zeros(6)
    for (x, y, z), d, duration in zip(points, displacements, dt, strict=True):
        D = np.hstack([[[0, -z, y], [z, 0, -x], [-y, x, 0]], -np.eye(3)])
        normal += duration**2 * D.T @ D
        right += duration * D.T @ d
    return np.linalg.solve(normal, right)


@given(seeds, st.floats(1e-9, 30))
@settings(deadline=None, max_examples=60)
def test_static_points_move_by_the_inverse_of_the_cameras_motion(seed: int, speed: float) -> None:
    points, _, dt = scene(seed, 20)
    velocity = speed * np.random.default_rng(seed).normal(size=6)
    T = np.linalg.inv(se3_exp(dt[:, None] * velocity))
    expected = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
    np.testing.assert_allclose(
        moved_points(points, dt, velocity), expected, atol=1e-12 * (1 + speed)
    )


@given(seeds, st.integers(3, 12))
@settings(deadline=None, max_examples=40)
def test_sample_velocity_is_the_linear_least_squares_one(seed: int, size: int) -> None:
    points, displacements, dt = scene(seed, 20)
    sample = np.random.default_rng(seed).permutation(20)[:size]
    solved, velocity = sample_velocity(points, displacements, dt, sample)
    assert solved
    expected = paper_velocity(points[sample], displacements[sample], dt[sample])
    np.testing.assert_allclose(velocity, expected, rtol=1e-6, atol=1e-8)


@given(seeds)
@settings(deadline=None, max_examples=40)
def test_sample_velocity_is_exact_to_first_order(seed: int) -> None:
    """A tenth of the motion gives a hundredth of the error, which is quadratic in the motion."""
    points, _, dt = scene(seed, 20)
    direction = np.random.default_rng(seed).normal(size=6)
    errors = []
    for scale in (1e-2, 1e-3):
        velocity = scale * direction
        displacements = moved_points(points, dt, velocity) - points
        errors.append(sample_velocity(points, displacements, dt, np.arange(20))[1] - velocity)
    assert 50 < np.linalg.norm(errors[0]) / np.linalg.norm(errors[1]) < 200


@pytest.mark.parametrize("count", [3, 8])
@pytest.mark.parametrize("direction", [[0.0, 0, 0], [1.0, 0, 0], [0.3, -0.2, 1.0]])
def test_points_on_a_line_determine_no_velocity(count: int, direction: list[float]) -> None:
    _, displacements, dt = scene(0, count)
    along = np.random.default_rng(0).uniform(-1, 1, count)
    points = np.array([0.1, -0.3, 3.0]) + along[:, None] * direction
    assert not sample_velocity(points, displacements, dt, np.arange(count))[0]


def project(points: Array) -> Array:
    fx, fy, cx, cy, baseline = CAMERA
    x, y, z = points.T
    return np.column_stack([fx * x / z + cx, fy * y / z + cy, fx * baseline / z])


def explained(points: Array, dt: Array, later: Array, velocity: Array) -> int:
    """Count the points that a velocity moves to within a pixel of their measurements."""
    error = np.linalg.norm(project(moved_points(points, dt, velocity)) - later, axis=1)
    return int((error <= 1.0).sum())


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_the_best_of_all_samples_is_returned(seed: int) -> None:
    points, _, dt = scene(seed, 9)
    rng = np.random.default_rng(seed)
    moved = moved_points(points, dt, rng.normal(0, 0.2, 6)) + rng.normal(0, 0.05, (9, 3))
    later, samples = project(moved), np.array(list(combinations(range(9), 3)))
    arguments = points, moved - points, dt, later, np.ones(9), samples, CAMERA, 1.0
    best = best_sample_velocity(*arguments)
    each = [sample_velocity(points, moved - points, dt, s)[1] for s in samples]
    counts = [explained(points, dt, later, velocity) for velocity in each]
    np.testing.assert_array_equal(best, each[np.argmax(counts)] if max(counts) else np.zeros(6))

    # The number of inliers does not depend on the order of samples and segments.
    order = rng.permutation(9)
    shuffled = np.argsort(order)[rng.permutation(samples)]
    points, moved, dt, later = points[order], moved[order], dt[order], later[order]
    arguments = points, moved - points, dt, later, np.ones(9), shuffled, CAMERA, 1.0
    assert explained(points, dt, later, best_sample_velocity(*arguments)) == max(counts)


def test_drawing_stops_only_once_it_is_confident() -> None:
    """Low confidence stops before the last sample, the only one that explains more segments."""
    points, _, dt = scene(0, 30)
    true = np.array([0.01, -0.02, 0.015, 0.1, -0.1, 0.2])
    moved = moved_points(points, dt, true)
    later = project(moved)
    # Half of the segments follow another velocity, a little more than half the true one.
    other = moved_points(points, dt, -true)
    moved[:14], later[:14] = other[:14], project(other)[:14]
    wrong_first = np.concatenate([np.tile([[0, 1, 2]], (40, 1)), [[20, 21, 22]]])
    tolerance = np.full(30, 0.3)
    arguments = points, moved - points, dt, later, tolerance, wrong_first, CAMERA
    # At 14 of 30 inliers, 0.9999 needs ln(1e-4)/ln(1 - (14/30)^3) = 86 samples, 0.9 needs 22.
    patient, hasty = best_sample_velocity(*arguments, 0.9999), best_sample_velocity(*arguments, 0.9)
    np.testing.assert_allclose(patient, true, atol=0.02)
    np.testing.assert_allclose(hasty, -true, atol=0.02)


@pytest.mark.parametrize(("count", "size"), [(3, 3), (5, 3), (6, 4)])
def test_samples_are_distinct_and_uniform(count: int, size: int) -> None:
    """All ordered samples pass a chi-squared test at a significance of about 1e-6."""
    iterations = 60_000
    samples = random_samples(count, size, iterations, np.random.default_rng(0))
    assert samples.min() >= 0 and samples.max() < count
    assert (np.diff(np.sort(samples, axis=1), axis=1) > 0).all()
    code = samples @ count ** np.arange(size)
    _, drawn = np.unique(code, return_counts=True)
    outcomes = np.prod(count - np.arange(size))
    assert len(drawn) == outcomes
    expected = iterations / outcomes
    statistic = ((drawn - expected) ** 2 / expected).sum()
    assert statistic < outcomes - 1 + 5 * np.sqrt(2 * (outcomes - 1)) + 10
