"""Interpolation by the Gaussian process: exactness, order of convergence, splines."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from factors.lie import se3_exp
from factors.wnoa import wnoa_error, wnoa_information
from gpvo.errors import InputError
from gpvo.evaluation.metrics.gp_interpolation import interpolate_by_gp, most_probable_velocities
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import rigid_transforms


def swing(t: np.ndarray) -> np.ndarray:
    """Return the poses of a smooth motion, far from constant velocity, at times t."""
    phase = np.outer(t, [1.0, 1.3, 0.7, 0.9, 1.1, 1.7])
    return se3_exp(np.sin(phase + np.arange(6)) * [1.0, 0.8, 0.6, 2.0, 1.0, 1.5])


def sampled(step: float) -> StampedPoses:
    t = np.arange(0.0, 6.0 + step / 2, step)
    return StampedPoses(np.round(t * 1e9).astype(np.int64), swing(t))


def test_it_passes_through_the_poses():
    poses = sampled(0.2)
    again = interpolate_by_gp(poses, poses.stamps_ns)
    np.testing.assert_allclose(again.T_world_cam, poses.T_world_cam, atol=1e-12)


def test_constant_velocity_is_reproduced():
    """This holds for irregular stamps and large rotations too."""
    twist = np.array([0.5, -1.0, 2.0, 1.0, 0.3, -0.2])
    t = np.array([0.0, 0.3, 0.35, 0.9, 1.4])
    poses = StampedPoses(np.round(t * 1e9).astype(np.int64), se3_exp(np.outer(t, twist)))
    np.testing.assert_allclose(most_probable_velocities(poses), np.tile(twist, (5, 1)), atol=1e-8)
    at = np.linspace(0.0, 1.4, 50)
    found = interpolate_by_gp(poses, np.round(at * 1e9).astype(np.int64))
    np.testing.assert_allclose(found.T_world_cam, se3_exp(np.outer(at, twist)), atol=1e-8)


def test_along_a_line_it_is_the_natural_spline():
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.05, 0.3, 20))
    positions = np.outer(rng.normal(size=20), [0.6, 0.0, 0.8])
    still = np.broadcast_to(np.eye(3), (20, 3, 3))
    stamps = np.round(t * 1e9).astype(np.int64)
    poses = StampedPoses(stamps, rigid_transforms(still, positions))
    spline = CubicSpline(stamps * 1e-9, positions, bc_type="natural")
    query = np.linspace(stamps[0], stamps[-1], 200).astype(np.int64)
    found = interpolate_by_gp(poses, query).positions
    np.testing.assert_allclose(found, spline(query * 1e-9), atol=1e-7)


def middle_error(step: float, interpolate) -> float:
    """Return the largest pose error half way between samples, without the ends."""
    poses = sampled(step)
    inner = poses.stamps_ns[len(poses) // 4 : -len(poses) // 4]
    middle = (inner[:-1] + inner[1:]) // 2
    return np.abs(interpolate(poses, middle).T_world_cam - swing(middle * 1e-9)).max()


def test_the_error_falls_with_the_fourth_power_of_the_step():
    """Linear interpolation is of second order."""
    order = {
        interpolate: np.log2(middle_error(0.1, interpolate) / middle_error(0.05, interpolate))
        for interpolate in (interpolate_by_gp, StampedPoses.interpolate)
    }
    assert order[interpolate_by_gp] == pytest.approx(4.0, abs=0.3)
    assert order[StampedPoses.interpolate] == pytest.approx(2.0, abs=0.2)


def test_the_velocities_minimise_the_prior(random_walk):
    """No small change of any velocity lowers the WNOA cost."""
    poses = random_walk(1, 8, 200_000_000)
    t = poses.seconds

    def cost(velocities):
        total = 0.0
        for k, h in enumerate(np.diff(t)):
            e, _ = wnoa_error(
                poses.T_world_cam[k], velocities[k], poses.T_world_cam[k + 1], velocities[k + 1], h
            )
            total += e @ wnoa_information(h, np.ones(6)) @ e
        return total

    best = most_probable_velocities(poses)
    rng = np.random.default_rng(0)
    for _ in range(20):
        assert cost(best + 1e-3 * rng.normal(size=best.shape)) > cost(best)


def test_it_does_not_extrapolate():
    poses = sampled(0.5)
    with pytest.raises(InputError, match="poses cover"):
        interpolate_by_gp(poses, [poses.stamps_ns[-1] + 1])
