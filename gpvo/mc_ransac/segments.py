"""Segments, which are landmarks measured twice, and the inliers of a velocity among them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.checks import checked_array
from factors.stereo import StereoCamera
from gpvo.array_table import ArrayTable
from gpvo.config import McRansacConfig
from gpvo.mc_ransac.fast_kernels import explained_kernel
from gpvo.tracking import Measurements

Array = NDArray[np.float64]
LEAST_DISPARITY = 1e-3
"""Pixels; below it the depth may be any."""


@dataclass(frozen=True, eq=False)
class Segments(ArrayTable):
    """Two measurements of each of N landmarks.

    Attributes
    ----------
    earlier, later
        (N, 3) measurements (u_left, v, disparity), rectified pixels.
    dt
        (N,) positive seconds from the earlier to the later one.

    Raises
    ------
    ValueError
        If a column has another shape or is not finite, or a dt is not positive: measurements the
        wrong way round would give the motion the wrong sign.
    """

    earlier: Array
    later: Array
    dt: Array

    def __post_init__(self) -> None:
        for name, element in (("earlier", (3,)), ("later", (3,)), ("dt", ())):
            column = checked_array(name, getattr(self, name), element)
            if column.shape != (np.size(self.dt), *element):
                raise ValueError(f"{name} must have a row for each dt, not {column.shape}")
            object.__setattr__(self, name, column)
        if not (self.dt > 0).all():
            raise ValueError(
                f"dt must be positive seconds, not {self.dt.min()}: earlier, then later"
            )


def segments_between(earlier: Measurements, later: Measurements) -> Segments:
    """Make segments (N,) from measurements (N,) and later ones (N,) of the same landmarks."""
    return Segments(earlier.stereo, later.stereo, later.t - earlier.t)


def are_inliers(
    segments: Segments, camera: StereoCamera, velocity: Array, config: McRansacConfig
) -> NDArray[np.bool_]:
    """Return which segments (N,) the velocity explains by e_rel, equation (err_ransac_classify)."""
    points, tolerance = camera.triangulate(segments.earlier), inlier_tolerance(segments, config)
    given = points, segments.dt, segments.later, tolerance, camera.parameters
    return np.asarray(explained_kernel(*given, velocity))


def inlier_tolerance(segments: Segments, config: McRansacConfig) -> Array:
    """Compute the largest reprojection error (N,) of an inlier, pixels.

    It is a share of the segment's length, at least `config.pixel_threshold`. The share also holds
    that of the disparity's error: the depth, on which the length depends, is off by as much.
    """
    length = np.linalg.norm(segments.later - segments.earlier, axis=1)
    of_depth = config.disparity_tolerance / np.maximum(segments.earlier[:, 2], LEAST_DISPARITY)
    share = np.hypot(config.relative_threshold, of_depth)
    return np.maximum(share * length, config.pixel_threshold)
