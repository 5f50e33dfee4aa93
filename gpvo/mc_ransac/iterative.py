"""Iterative MC-RANSAC, section III-B.2: a velocity refined by Gauss-Newton on its inliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import checked_positive_definite, checked_vector
from factors.stereo import StereoCamera
from gpvo.config import McRansacConfig
from gpvo.mc_ransac.fast_kernels import explained_kernel
from gpvo.mc_ransac.iterative_kernels import covariance_kernel, fit_kernel
from gpvo.mc_ransac.segments import Segments, inlier_tolerance

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VelocityFit:
    """Velocity found by MC-RANSAC, its covariance and its inliers.

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


def iterative_mc_ransac(
    segments: Segments,
    camera: StereoCamera,
    information: ArrayLike,
    velocity: ArrayLike,
    inliers: NDArray[np.bool_],
    config: McRansacConfig,
) -> VelocityFit | None:
    """Refine a velocity by Gauss-Newton on its inliers and select them again, section III-B.2.

    This is done up to `config.refinements` times, because a refined velocity explains more
    segments. `information` is R^-1 of a measurement, (3, 3) or its diagonal (3,). Returns None if
    the inliers do not determine a velocity.

    Raises
    ------
    ValueError
        If the information, the velocity or the inliers have another shape or are not finite.
    """
    information = checked_positive_definite("information", information, 3)
    fitted: Array = checked_vector("velocity", velocity, 6)
    inliers = np.asarray(inliers)
    if inliers.dtype != bool or inliers.shape != (len(segments),):
        raise ValueError(f"inliers must be one truth value for each of {len(segments)} segments")
    given = camera.triangulate(segments.earlier), segments.dt, segments.later
    intrinsics, tolerance = camera.parameters, inlier_tolerance(segments, config)
    limits = config.refinement_iterations, config.refinement_tolerance
    for _ in range(config.refinements):
        chosen = [column[inliers] for column in given]
        fitted, normal = fit_kernel(*chosen, information, intrinsics, fitted, *limits)
        if not np.isfinite(fitted).all() or np.linalg.cond(normal) > config.max_condition:
            return None
        before, inliers = inliers, explained_kernel(*given, tolerance, intrinsics, fitted)
        if (inliers == before).all() or inliers.sum() < config.sample_size:
            break
    covariance = covariance_kernel(*chosen, information, intrinsics, fitted)
    return VelocityFit(fitted, covariance, inliers)
