"""Segments, which are landmarks measured twice, and the inliers of a velocity among them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.stereo import StereoCamera
from gpvo.array_table import ArrayTable
from gpvo.config import McRansacConfig
from gpvo.mc_ransac.fast_kernels import moved_points
from gpvo.tracking import Measurements

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Segments(ArrayTable):
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


def segments_between(earlier: Measurements, later: Measurements) -> Segments:
    """Make segments (N,) from measurements (N,) and later ones (N,) of the same landmarks."""
    return Segments(earlier.stereo, later.stereo, later.t - earlier.t)


def are_inliers(
    segments: Segments, camera: StereoCamera, velocity: Array, config: McRansacConfig
) -> NDArray[np.bool_]:
    """Return which segments (N,) the velocity explains by e_rel, equation (err_ransac_classify)."""
    points = moved_points(camera.triangulate(segments.earlier), segments.dt, velocity)
    error = np.linalg.norm(camera.project(points) - segments.later, axis=1)
    return (points[:, 2] > 0) & (error <= inlier_tolerance(segments, config))


def inlier_tolerance(segments: Segments, config: McRansacConfig) -> Array:
    """Compute the largest reprojection error (N,) of an inlier, pixels.

    It is a share of the segment's length, at least `config.pixel_threshold`.
    """
    length = np.linalg.norm(segments.later - segments.earlier, axis=1)
    return np.maximum(config.relative_threshold * length, config.pixel_threshold)
