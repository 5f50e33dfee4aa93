"""What of a posterior variance is error, if the motion is smoother than the prior expects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from runs import METHODS, estimate
from synthetic import tracklets

from factors.wnoa import information_root
from gpvo.config import Configuration, NoiseConfig
from gpvo.estimator import one_blas_thread
from gpvo.trajectory import Trajectory
from gpvo.trajectory.smooth_motion import LONG, velocity_scale


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    return estimate(tracklets(noise=0.3), method="fixed_lag")


@settings(deadline=None, max_examples=20)
@given(st.floats(-2, 2))
def test_a_quarter_of_a_velocity_and_three_of_a_pose_are_noise(exponent: float) -> None:
    """Of a camera that is measured often in the time (r dt / q)^(1/4) that the smoother follows."""
    n, dt, r = 401, 0.1, 10.0**exponent
    q = r * dt / (20 * dt) ** 4
    position, velocity = np.eye(2 * n)[::2], np.eye(2 * n)[1::2]
    errors = np.stack([np.diff(position, axis=0) - dt * velocity[:-1], np.diff(velocity, axis=0)])
    root = information_root(np.array([dt]))[0] / np.sqrt(q)
    prior = np.einsum("ab,bki->aki", root, errors).reshape(-1, 2 * n)
    measured = position.T @ position / r
    with one_blas_thread():
        posterior = np.linalg.inv(prior.T @ prior + measured)
        of_noise = posterior @ measured @ posterior
    share = (np.diagonal(of_noise) / np.diagonal(posterior))[n - 1 : n + 1]
    assert share == pytest.approx([0.75, 0.25], rel=1e-3)


@settings(deadline=None, max_examples=50)
@given(st.integers(2, 40), st.floats(0.01, 1.0), st.data())
def test_a_velocity_is_more_certain_amid_others_alone(
    knots: int, share: float, data: st.DataObject
) -> None:
    t = np.arange(knots, dtype=float)
    gap = data.draw(st.integers(1, knots - 1))
    for later in (0.0, LONG):
        t[gap:] += later if knots > 2 else 0.0
        number = np.arange(knots)
        ends = np.minimum(number, knots - 1 - number)
        beside = np.minimum(abs(number - gap), abs(number - gap + 1)) if later else knots
        expected = np.where(np.minimum(ends, beside) < 2, 1.0, np.sqrt(share))
        np.testing.assert_array_equal(velocity_scale(t, share), expected)


def test_it_changes_covariances_of_velocities_alone(trajectory: Trajectory) -> None:
    smooth = replace(trajectory, velocity_scale=scale_of(trajectory, 0.25))
    t = np.linspace(trajectory.start, trajectory.stop, 200)
    np.testing.assert_array_equal(smooth.velocity(t), trajectory.velocity(t))
    whole, part = trajectory.covariance(t), smooth.covariance(t)
    np.testing.assert_array_equal(part[:, :6, :6], whole[:, :6, :6])
    ratio = np.diagonal(part, 0, 1, 2)[:, 6:] / np.diagonal(whole, 0, 1, 2)[:, 6:]
    assert ratio.min() == pytest.approx(0.25)
    np.testing.assert_allclose(ratio[[0, -1]], 1.0)
    assert (np.linalg.eigvalsh(part) > 0).all()


def scale_of(trajectory: Trajectory, share: float) -> np.ndarray:
    return velocity_scale(trajectory.t[trajectory.knots], share)


@pytest.mark.parametrize("method", METHODS)
def test_trajectories_have_the_share_that_is_configured(method: str) -> None:
    parts, noise = tracklets(noise=0.3), NoiseConfig(velocity_share=0.25)
    found = estimate(parts, noise, method=method)
    np.testing.assert_array_equal(found.velocity_scale, scale_of(found, 0.25))
    white = estimate(parts, method=method)
    np.testing.assert_array_equal(white.velocity_scale, 1.0)


def test_the_paper_expects_white_noise() -> None:
    assert Configuration().noise.velocity_share == 0.25
    assert Configuration.model_validate({"preset": "paper"}).noise.velocity_share == 1.0


@pytest.mark.parametrize("share", [None, 0.25, 1.0])
def test_a_trajectory_that_was_saved_before_keeps_its_covariance(
    trajectory: Trajectory, tmp_path: Path, share: float | None
) -> None:
    """Earlier versions wrote the share, or nothing of it."""
    path = tmp_path / "trajectory.npz"
    trajectory.save(path)
    with np.load(path) as file:
        before = {name: file[name] for name in file if name != "velocity_scale"}
    np.savez(path, **before, **({} if share is None else {"velocity_share": np.array(share)}))
    loaded = Trajectory.load(path)
    expected = replace(trajectory, velocity_scale=scale_of(trajectory, share or 1.0))
    t = np.linspace(trajectory.start, trajectory.stop, 20)
    np.testing.assert_array_equal(loaded.covariance(t), expected.covariance(t))
    loaded.save(path)
    np.testing.assert_array_equal(Trajectory.load(path).covariance(t), expected.covariance(t))
