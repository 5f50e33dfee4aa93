"""MC-RANSAC recovers velocities from asynchronous segments, and reports their uncertainty."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from velocity_reference import reprojection_error, velocity_covariance

from factors.stereo import StereoCamera
from gpvo.config import McRansacConfig
from gpvo.mc_ransac import Segments, fast_mc_ransac, iterative_mc_ransac, mc_ransac
from gpvo.mc_ransac.iterative_kernels import covariance_kernel, normal_equations
from gpvo.mc_ransac.moved_points import moved_points
from gpvo.mc_ransac.segments import are_inliers, inlier_tolerance

Array = NDArray[np.float64]
seeds = st.integers(0, 2**32)
CAMERA = StereoCamera(200.0, 210.0, 120.0, 90.0, 0.1)
INFORMATION = np.diag([0.5, 0.5, 0.1])
CONFIG = McRansacConfig(iterations=300)
EXACT = McRansacConfig(iterations=300, refinement_tolerance=1e-12)
# Durations for which the linear motion of the fast version is exact to a pixel.
SHORT = (0.02, 0.12)
PAPER = McRansacConfig(
    iterations=300, pixel_threshold=0, disparity_tolerance=0, confidence=1, refinements=1
)


def random_segments(
    rng: np.random.Generator, count: int, velocity: Array, dt: tuple[float, float] = (0.02, 0.4)
) -> Segments:
    """Make exact measurements of static points, each at two times of its own."""
    points = rng.uniform([-1.5, -1, 1.5], [1.5, 1, 6], (count, 3))
    duration = rng.uniform(*dt, count)
    later = moved_points(points, duration, velocity)
    return Segments(CAMERA.project(points), CAMERA.project(later), duration)


def random_velocity(rng: np.random.Generator) -> Array:
    return rng.normal(0, [0.3, 0.3, 0.3, 0.4, 0.4, 0.4])


def with_outliers(
    rng: np.random.Generator, segments: Segments, share: float
) -> tuple[Segments, NDArray[np.bool_]]:
    """Move a share of the later measurements by 10 to 40 pixels; also return which are good."""
    good = rng.permutation(len(segments)) >= share * len(segments)
    away = rng.uniform(10, 40, (len(segments), 3)) * rng.choice([-1, 1], (len(segments), 3))
    away[:, 2] = rng.uniform(1, 4, len(segments))
    return Segments(segments.earlier, segments.later + ~good[:, None] * away, segments.dt), good


def noisy(rng: np.random.Generator, segments: Segments, deviation: Array) -> Segments:
    return Segments(
        segments.earlier + rng.normal(size=segments.earlier.shape) * deviation,
        segments.later + rng.normal(size=segments.later.shape) * deviation,
        segments.dt,
    )


def found_by(
    segments: Segments, config: McRansacConfig = CONFIG, seed: int = 0
) -> tuple[Array, NDArray[np.bool_]]:
    fit = mc_ransac(segments, CAMERA, INFORMATION, config, np.random.default_rng(seed))
    assert fit is not None
    return fit.velocity, fit.inliers


@given(seeds, st.integers(6, 60))
@settings(deadline=None, max_examples=40)
def test_exact_segments_give_the_exact_velocity(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    true = random_velocity(rng)
    velocity, inliers = found_by(random_segments(rng, count, true, SHORT), EXACT)
    np.testing.assert_allclose(velocity, true, atol=1e-9)
    assert inliers.all()


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_fast_version_is_exact_to_first_order(seed: int) -> None:
    """A tenth of the motion gives a hundredth of the error, which is quadratic in the motion."""
    rng = np.random.default_rng(seed)
    true, config = random_velocity(rng), McRansacConfig(iterations=1, sample_size=12)
    points = rng.uniform([-1.5, -1, 1.5], [1.5, 1, 6], (12, 3))
    errors = []
    for dt in (1e-2, 1e-3):
        moved = moved_points(points, np.full(12, dt), true)
        segments = Segments(CAMERA.project(points), CAMERA.project(moved), np.full(12, dt))
        found = fast_mc_ransac(segments, CAMERA, config, np.random.default_rng(0))
        errors.append(np.linalg.norm(found - true) * dt)
    assert 50 < errors[0] / errors[1] < 200


@pytest.mark.parametrize("seed", range(10))
def test_outliers_are_told_from_inliers(seed: int) -> None:
    """Half of the segments are wrong, all are noisy; inliers are those the truth explains."""
    rng = np.random.default_rng(seed)
    true = random_velocity(rng)
    exact, good = with_outliers(rng, random_segments(rng, 120, true, SHORT), 0.5)
    segments = noisy(rng, exact, np.array([0.2, 0.2, 0.1]))
    config = McRansacConfig(iterations=3000)
    _, inliers = found_by(segments, config)
    explained = are_inliers(segments, CAMERA, true, config) & good
    assert explained.sum() > 0.85 * good.sum()
    assert not (inliers & ~good).any()
    assert (inliers & explained).sum() >= 0.95 * explained.sum()


def test_wrong_segments_do_not_move_the_velocity() -> None:
    rng = np.random.default_rng(3)
    true = random_velocity(rng)
    exact, good = with_outliers(rng, random_segments(rng, 100, true), 0.5)
    velocity, inliers = found_by(exact, EXACT)
    np.testing.assert_array_equal(inliers, good)
    np.testing.assert_allclose(velocity, true, atol=1e-9)


def test_the_same_seed_gives_the_same_bits() -> None:
    rng = np.random.default_rng(0)
    segments, _ = with_outliers(rng, random_segments(rng, 60, random_velocity(rng)), 0.4)
    segments = noisy(rng, segments, np.array([0.1, 0.1, 0.05]))
    first, again = (found_by(segments, PAPER, seed=5) for _ in range(2))
    assert first[0].tobytes() == again[0].tobytes()
    np.testing.assert_array_equal(first[1], again[1])


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_the_order_of_segments_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    exact = random_segments(rng, 40, random_velocity(rng), SHORT)
    segments, _ = with_outliers(rng, exact, 0.4)
    order = rng.permutation(40)
    (velocity, inliers), (other, permuted) = (
        found_by(segments, EXACT),
        found_by(segments[order], EXACT),
    )
    np.testing.assert_array_equal(inliers[order], permuted)
    np.testing.assert_allclose(velocity, other, atol=1e-9)


@given(seeds, st.floats(0.01, 3))
@settings(deadline=None, max_examples=40)
def test_jacobian_is_the_derivative_of_the_error(seed: int, speed: float) -> None:
    rng = np.random.default_rng(seed)
    velocity = speed * random_velocity(rng)
    segments = random_segments(rng, 10, random_velocity(rng), dt=(0.02, 0.2))
    points = moved_points(CAMERA.triangulate(segments.earlier), segments.dt, velocity)
    assume((points[:, 2] > 0.5).all())
    _, jacobian = reprojection_error(segments, CAMERA, velocity)
    h = 1e-5
    for axis, step in enumerate(h * np.eye(6)):
        ahead, _ = reprojection_error(segments, CAMERA, velocity + step)
        back, _ = reprojection_error(segments, CAMERA, velocity - step)
        np.testing.assert_allclose(jacobian[..., axis], (ahead - back) / (2 * h), atol=1e-5)


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_normal_equations_are_those_of_the_errors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    velocity = random_velocity(rng)
    segments = noisy(rng, random_segments(rng, 10, velocity, dt=(0.02, 0.2)), np.ones(3))
    mixed = INFORMATION + 0.02
    error, jacobian = reprojection_error(segments, CAMERA, velocity)
    weighted = (mixed @ jacobian).reshape(-1, 6)
    points = CAMERA.triangulate(segments.earlier)
    arguments = (segments.dt, segments.later, velocity, mixed, CAMERA.parameters)
    normal, right = normal_equations(points, *arguments)
    expected = weighted.T @ jacobian.reshape(-1, 6)
    np.testing.assert_allclose(normal, expected, atol=1e-10 * expected.max())
    scale = (np.abs(weighted).T @ np.abs(error.ravel())).max()
    np.testing.assert_allclose(right, weighted.T @ error.ravel(), atol=1e-10 * scale)


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_covariance_is_that_of_the_formula(seed: int) -> None:
    rng = np.random.default_rng(seed)
    velocity = random_velocity(rng)
    segments = noisy(rng, random_segments(rng, 12, velocity), np.ones(3))
    mixed = INFORMATION + 0.02
    points = CAMERA.triangulate(segments.earlier)
    given = points, segments.dt, segments.later, mixed, CAMERA.parameters, velocity
    expected = velocity_covariance(segments, CAMERA, mixed, velocity)
    found = covariance_kernel(*given)
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())
    np.testing.assert_allclose(found, found.T, atol=1e-9 * np.abs(expected).max())


@given(seeds)
@settings(deadline=None, max_examples=20)
def test_iterations_end_where_the_cost_is_flat(seed: int) -> None:
    """The gradient of equation (iter_cost_func) is zero at the velocity that is returned."""
    rng = np.random.default_rng(seed)
    true = random_velocity(rng)
    segments = noisy(rng, random_segments(rng, 30, true), np.array([0.5, 0.5, 0.3]))
    once = EXACT.model_copy(update={"refinements": 1})
    fit = iterative_mc_ransac(segments, CAMERA, INFORMATION, true, np.ones(30, bool), once)
    assert fit is not None
    error, jacobian = reprojection_error(segments, CAMERA, fit.velocity)
    gradient = np.einsum("nji,jk,nk->i", jacobian, INFORMATION, error)
    size = np.einsum("nji,jk,nk->ni", np.abs(jacobian), INFORMATION, np.abs(error)).sum(axis=0)
    assert (np.abs(gradient) < 1e-9 * size).all()


def test_covariance_is_that_of_repeated_noise() -> None:
    """Whitened estimates of 600 noisy repetitions have the covariance 1, to 5 deviations."""
    rng = np.random.default_rng(0)
    true, repetitions = random_velocity(rng), 600
    exact = random_segments(rng, 40, true)
    information = INFORMATION * 1e6  # so little noise that the measurement is linear in it
    deviation = 1 / np.sqrt(np.diag(information))
    everything, config = np.ones(40, bool), McRansacConfig(refinement_iterations=4)
    estimates = []
    for _ in range(repetitions):
        segments = noisy(rng, exact, deviation)
        fit = iterative_mc_ransac(segments, CAMERA, information, true, everything, config)
        assert fit is not None
        estimates.append(fit.velocity - true)
    covariance = velocity_covariance(exact, CAMERA, information, true)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=0.1, atol=0.05 * covariance.max())
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), np.array(estimates).T)
    spread = np.sqrt((1 + np.eye(6)) / repetitions)
    assert (np.abs(whitened @ whitened.T / repetitions - np.eye(6)) < 5 * spread).all()
    assert (np.abs(whitened.mean(axis=1)) < 5 / np.sqrt(repetitions)).all()


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_uncertainty_is_honest_with_outliers(share: float) -> None:
    """NEES over 100 draws lies in its 99 % interval: inliers are judged until they stay."""
    deviation, draws, total = np.array([0.28, 0.28, 0.21]), 100, 0.0
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        true = random_velocity(rng)
        exact, _ = with_outliers(rng, random_segments(rng, 150, true, (0.07, 0.13)), share)
        segments = noisy(rng, exact, deviation)
        fit = mc_ransac(segments, CAMERA, deviation**-2.0, McRansacConfig(), rng)
        assert fit is not None
        error = fit.velocity - true
        total += error @ np.linalg.solve(fit.covariance, error)
    assert abs(total - 6 * draws) < 2.58 * np.sqrt(2 * 6 * draws)


def degenerate_segments(name: str) -> Segments:
    rng = np.random.default_rng(0)
    count = 2 if name == "two" else 0 if name == "none" else 20
    points = rng.uniform([-1, -1, 2], [1, 1, 5], (count, 3))
    dt = rng.uniform(0.05, 0.2, count)
    velocity = random_velocity(rng)
    if name == "identical":
        points, dt = np.tile([0.3, -0.2, 3.0], (count, 1)), np.full(count, 0.1)
    if name == "line":
        points = np.array([0.1, 0.2, 3.0]) + rng.uniform(-1, 1, (count, 1)) * [1.0, 0.5, 0.7]
    later = CAMERA.project(moved_points(points, dt, velocity))
    if name == "contradictory":
        later = CAMERA.project(rng.uniform([-2, -2, 0.5], [2, 2, 9], (count, 3)))
    return Segments(CAMERA.project(points), later, dt)


@pytest.mark.parametrize("config", [CONFIG, PAPER])
@pytest.mark.parametrize("name", ["none", "two", "identical", "line"])
def test_segments_that_determine_no_velocity_give_none(name: str, config: McRansacConfig) -> None:
    segments = degenerate_segments(name)
    assert mc_ransac(segments, CAMERA, INFORMATION, config, np.random.default_rng(0)) is None


@given(seeds, st.sampled_from([CONFIG, PAPER]))
@settings(deadline=None, max_examples=60)
def test_segments_without_a_common_velocity_give_none_or_numbers(
    seed: int, config: McRansacConfig
) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 15))
    earlier, later = (
        CAMERA.project(rng.uniform([-2, -2, 0.3], [2, 2, 30], (count, 3))) for _ in range(2)
    )
    segments = Segments(earlier, later, rng.uniform(1e-6, 0.5, count))
    fit = mc_ransac(segments, CAMERA, INFORMATION, config, rng)
    if fit is not None:
        assert np.isfinite(fit.velocity).all() and np.isfinite(fit.covariance).all()
        assert (np.linalg.eigvalsh(fit.covariance) > 0).all()


def test_a_still_camera_has_no_velocity() -> None:
    segments = random_segments(np.random.default_rng(0), 30, np.zeros(6))
    for config in (CONFIG, PAPER):
        velocity, inliers = found_by(segments, config)
        np.testing.assert_allclose(velocity, 0, atol=1e-9)
        assert inliers.all()


def test_inliers_of_the_paper_have_a_small_relative_error() -> None:
    """An inlier's error is at most 5 % of its segment's length, which is a stereo distance."""
    rng = np.random.default_rng(1)
    velocity = random_velocity(rng)
    exact = random_segments(rng, 200, velocity)
    length = np.linalg.norm(exact.later - exact.earlier, axis=1)
    direction = rng.normal(size=(200, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    share = rng.uniform(0, 0.1, 200)
    # The error is added to the later measurement, because the earlier one moves the prediction.
    moved = Segments(exact.earlier, exact.later + direction * (share * length)[:, None], exact.dt)
    error = share * length
    moved_length = np.linalg.norm(moved.later - moved.earlier, axis=1)
    expected = error <= 0.05 * moved_length
    assert 50 < expected.sum() < 150
    np.testing.assert_array_equal(are_inliers(moved, CAMERA, velocity, PAPER), expected)
    np.testing.assert_allclose(inlier_tolerance(moved, PAPER), 0.05 * moved_length)

    ours = are_inliers(moved, CAMERA, velocity, CONFIG)
    of_depth = CONFIG.disparity_tolerance / moved.earlier[:, 2]
    expected = error <= np.hypot(0.05, of_depth) * moved_length
    np.testing.assert_array_equal(ours, expected | (error <= CONFIG.pixel_threshold))


def test_what_is_far_may_be_off_by_its_depth() -> None:
    """A disparity off by a share makes the way of a point in the image longer by that share."""
    rng = np.random.default_rng(4)
    velocity = np.array([0, 0, 0, 0.5, 0.1, 8.0])
    points = rng.uniform([-8, -6, 8], [8, 6, 20], (200, 3))
    dt = rng.uniform(0.1, 0.3, 200)
    earlier, later = CAMERA.project(points), CAMERA.project(moved_points(points, dt, velocity))
    earlier[:, 2] += rng.uniform(-0.3, 0.3, 200)
    segments = Segments(earlier, later, dt)
    assert are_inliers(segments, CAMERA, velocity, CONFIG).all()
    without = CONFIG.model_copy(update={"disparity_tolerance": 0.0})
    assert are_inliers(segments, CAMERA, velocity, without).mean() < 0.7


def test_points_behind_the_camera_are_no_inliers() -> None:
    segments = random_segments(np.random.default_rng(0), 20, np.zeros(6), dt=(1.0, 1.0))
    ahead = np.array([0, 0, 0, 0, 0, 10.0])
    assert not are_inliers(segments, CAMERA, ahead, McRansacConfig(pixel_threshold=1e9)).any()


def test_the_paper_draws_all_samples() -> None:
    """At confidence 1 the result does not depend on the samples that were found early."""
    rng = np.random.default_rng(2)
    true = random_velocity(rng)
    segments = noisy(rng, random_segments(rng, 50, true), np.array([0.5, 0.5, 0.3]))
    counts = []
    for confidence in (0.5, 1.0):
        config = McRansacConfig(iterations=300, confidence=confidence)
        velocity = fast_mc_ransac(segments, CAMERA, config, np.random.default_rng(0))
        counts.append(are_inliers(segments, CAMERA, velocity, config).sum())
    assert counts[0] < counts[1]


def test_a_seed_a_diagonal_and_lists_are_as_good_as_arrays() -> None:
    rng = np.random.default_rng(4)
    segments, _ = with_outliers(rng, random_segments(rng, 40, random_velocity(rng), SHORT), 0.2)
    lists = Segments(segments.earlier.tolist(), segments.later.tolist(), segments.dt.tolist())
    diagonal = np.diag(INFORMATION).tolist()
    expected = mc_ransac(segments, CAMERA, INFORMATION, CONFIG, np.random.default_rng(7))
    found = mc_ransac(lists, CAMERA.to_gtsam(), diagonal, CONFIG, 7)
    assert expected is not None and found is not None
    np.testing.assert_array_equal(found.velocity, expected.velocity)
    np.testing.assert_array_equal(found.covariance, expected.covariance)
    np.testing.assert_array_equal(found.inliers, expected.inliers)
    one_more = iterative_mc_ransac(
        lists, CAMERA, diagonal, found.velocity.tolist(), found.inliers, CONFIG
    )
    assert one_more is not None
    np.testing.assert_array_equal(
        fast_mc_ransac(segments, CAMERA, CONFIG, 7),
        fast_mc_ransac(segments, CAMERA, CONFIG, np.random.default_rng(7)),
    )


def test_bad_input_is_refused_by_name() -> None:
    good = random_segments(np.random.default_rng(0), 10, np.zeros(6))
    three, rows = good.earlier, good.earlier[:9]
    for name, make in (
        ("dt must be positive", lambda: Segments(three, three, -good.dt)),
        ("dt must be positive", lambda: Segments(three, three, 0 * good.dt)),
        ("dt must be finite", lambda: Segments(three, three, np.nan * good.dt)),
        ("dt", lambda: Segments(three, three, good.dt[:, None])),
        ("earlier", lambda: Segments(three[:, :2], three, good.dt)),
        ("later", lambda: Segments(three, rows, good.dt)),
        ("later", lambda: Segments(three, three * np.inf, good.dt)),
        ("information", lambda: mc_ransac(good, CAMERA, [1, 1], CONFIG, 0)),
        ("information", lambda: mc_ransac(good, CAMERA, [1, 1, -1], CONFIG, 0)),
        ("information", lambda: mc_ransac(good, CAMERA, "high", CONFIG, 0)),  # type: ignore[arg-type]
        ("information", lambda: mc_ransac(good, CAMERA, np.eye(6), CONFIG, 0)),
        ("segments", lambda: fast_mc_ransac(good[:2], CAMERA, CONFIG, 0)),
        ("rng", lambda: mc_ransac(good, CAMERA, INFORMATION, CONFIG, -1)),
        ("rng", lambda: mc_ransac(good, CAMERA, INFORMATION, CONFIG, 1.5)),  # type: ignore[arg-type]
        ("rng", lambda: mc_ransac(good, CAMERA, INFORMATION, CONFIG, None)),  # type: ignore[arg-type]
        (
            "inliers",
            lambda: iterative_mc_ransac(
                good, CAMERA, INFORMATION, np.zeros(6), np.ones(3, bool), CONFIG
            ),
        ),
        (
            "velocity",
            lambda: iterative_mc_ransac(
                good, CAMERA, INFORMATION, np.zeros(3), np.ones(10, bool), CONFIG
            ),
        ),
    ):
        with pytest.raises(ValueError, match=name):
            make()
