"""Motion-compensated RANSAC: one constant SE(3) velocity explains the inlier tracklet segments.

Section III-B of the paper. A segment is one landmark measured at two times of its own; there is no
common time. Velocities are body twists of the left camera, rotation first, T(t + dt) = T(t)
Exp(dt v): a static point moves through the camera frame as p(t + dt) = Exp(-dt v) p(t).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.lie import se3_exp, se3_left_jacobian, skew
from factors.stereo import StereoCamera
from gpvo.config.stages import McRansacConfig
from gpvo.constant_velocity import best_sample_velocity, moved_points
from gpvo.velocity_refinement import normal_equations

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Segments:
    """Two measurements of each of N landmarks.

    Attributes
    ----------
    earlier, later
        (N, 3) measurements (u_left, v, disparity), rectified pixels.
    dt
        (N,) positive seconds from the earlier to the later one.
    """

    earlier: Array
    later: Array
    dt: Array

    def __len__(self) -> int:
        return len(self.dt)

    def __getitem__(self, index: NDArray) -> Segments:
        return Segments(self.earlier[index], self.later[index], self.dt[index])


@dataclass(frozen=True, eq=False)
class VelocityFit:
    """What MC-RANSAC finds.

    Attributes
    ----------
    velocity
        (6,) body twist, rotation first, rad/s and m/s.
    covariance
        (6, 6) of the velocity, if both measurements of a segment have the given noise.
    inliers
        (N,) bool, which segments the velocity explains.
    """

    velocity: Array
    covariance: Array
    inliers: NDArray[np.bool_]


def mc_ransac(
    segments: Segments,
    camera: StereoCamera,
    information: Array,
    config: McRansacConfig,
    rng: np.random.Generator,
) -> VelocityFit | None:
    """Find the largest set of segments that one velocity explains, and that velocity.

    The fast version proposes an inlier set, the iterative version refines it. `information` (3, 3)
    is the inverse covariance R^-1 of a measurement. None if no sample has enough inliers.
    """
    if len(segments) < config.sample_size:
        return None
    velocity = fast_mc_ransac(segments, camera, config, rng)
    inliers = are_inliers(segments, camera, velocity, config)
    if inliers.sum() < config.sample_size:
        return None
    return iterative_mc_ransac(segments, camera, information, velocity, inliers, config)


def fast_mc_ransac(
    segments: Segments, camera: StereoCamera, config: McRansacConfig, rng: np.random.Generator
) -> Array:
    """Velocity (6,) of the random sample that explains most segments, section III-B.1."""
    points = camera.triangulate(segments.earlier)
    displacements = camera.triangulate(segments.later) - points
    return best_sample_velocity(
        points,
        displacements,
        segments.dt,
        segments.later,
        inlier_tolerance(segments, config),
        random_samples(len(segments), config.sample_size, config.iterations, rng),
        camera.parameters,
        config.confidence,
    )


def random_samples(
    count: int, size: int, iterations: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """(iterations, size) indices below `count`, uniform and distinct within a row."""
    samples = rng.integers(0, count - np.arange(size), size=(iterations, size))
    for column in range(1, size):
        for earlier in np.sort(samples[:, :column], axis=1).T:
            samples[:, column] += samples[:, column] >= earlier
    return samples


def iterative_mc_ransac(
    segments: Segments,
    camera: StereoCamera,
    information: Array,
    velocity: Array,
    inliers: NDArray[np.bool_],
    config: McRansacConfig,
) -> VelocityFit | None:
    """Refine a velocity by Gauss-Newton on its inliers and segment anew, section III-B.2.

    That is done `config.refinements` times, as a refined velocity explains more segments.
    """
    for _ in range(config.refinements):
        chosen = segments[inliers]
        refined = _refined_velocity(chosen, camera, information, velocity, config)
        if refined is None:
            return None
        velocity, before = refined, inliers
        inliers = are_inliers(segments, camera, velocity, config)
        if (inliers == before).all() or inliers.sum() < config.sample_size:
            break
    covariance = velocity_covariance(chosen, camera, information, velocity)
    return VelocityFit(velocity, covariance, inliers)


def _refined_velocity(
    segments: Segments,
    camera: StereoCamera,
    information: Array,
    velocity: Array,
    config: McRansacConfig,
) -> Array | None:
    """Velocity of the least weighted reprojection errors; None where they do not determine it."""
    points = camera.triangulate(segments.earlier)
    for _ in range(config.refinement_iterations):
        normal, right = normal_equations(
            points, segments.dt, segments.later, velocity, information, camera.parameters
        )
        if not np.isfinite(normal).all() or np.linalg.cond(normal) > config.max_condition:
            return None
        step = np.linalg.solve(normal, right)
        velocity = velocity - step
        if np.abs(step).max() < config.refinement_tolerance:
            break
    return velocity


def reprojection_error(
    segments: Segments, camera: StereoCamera, velocity: Array
) -> tuple[Array, Array]:
    """Predicted minus measured later measurement (N, 3), and its Jacobian (N, 3, 6) by velocity.

    Equation (iter_err) with the opposite sign, so that the Jacobian is that of the prediction.
    """
    points = moved_points(camera.triangulate(segments.earlier), segments.dt, velocity)
    predicted, by_point = camera.project_with_jacobian(points)
    step = -segments.dt[:, None] * velocity
    by_twist = np.concatenate([-skew(points), np.broadcast_to(np.eye(3), (len(points), 3, 3))], 2)
    by_velocity = -segments.dt[:, None, None] * (by_twist @ se3_left_jacobian(step))
    return predicted - segments.later, by_point @ by_velocity


def velocity_covariance(
    segments: Segments, camera: StereoCamera, information: Array, velocity: Array
) -> Array:
    """Covariance (6, 6) of the velocity that minimizes the reprojection errors of segments.

    The cost weights errors by R^-1, but they have the noise of both measurements: R for the later
    one, and R through the prediction for the earlier one.
    """
    _, by_velocity = reprojection_error(segments, camera, velocity)
    by_earlier = _prediction_by_earlier(segments, camera, velocity)
    R = np.linalg.inv(information)
    noise = R + by_earlier @ R @ by_earlier.transpose(0, 2, 1)
    weighted = np.einsum("nij,ik->njk", by_velocity, information)
    gain = np.linalg.solve(np.einsum("nij,njk->ik", weighted, by_velocity), weighted)
    return np.einsum("nij,njk,nlk->il", gain, noise, gain)


def _prediction_by_earlier(segments: Segments, camera: StereoCamera, velocity: Array) -> Array:
    """(N, 3, 3) derivative of the predicted later measurement by the earlier one."""
    points = camera.triangulate(segments.earlier)
    rotation = se3_exp(-segments.dt[:, None] * velocity)[:, :3, :3]
    _, by_moved = camera.project_with_jacobian(moved_points(points, segments.dt, velocity))
    _, by_point = camera.project_with_jacobian(points)
    return by_moved @ rotation @ np.linalg.inv(by_point)


def are_inliers(
    segments: Segments, camera: StereoCamera, velocity: Array, config: McRansacConfig
) -> NDArray[np.bool_]:
    """Which segments (N,) the velocity explains: e_rel, equation (err_ransac_classify)."""
    points = moved_points(camera.triangulate(segments.earlier), segments.dt, velocity)
    error = np.linalg.norm(camera.project(points) - segments.later, axis=1)
    return (points[:, 2] > 0) & (error <= inlier_tolerance(segments, config))


def inlier_tolerance(segments: Segments, config: McRansacConfig) -> Array:
    """(N,) largest reprojection error of an inlier, pixels: a share of the segment's length."""
    length = np.linalg.norm(segments.later - segments.earlier, axis=1)
    return np.maximum(config.relative_threshold * length, config.pixel_threshold)
