"""Motion-compensated RANSAC: one constant SE(3) velocity explains the inlier tracklet segments.

Section III-B of the paper. A segment is one landmark measured at two times of its own; there is no
common time. Velocities are body twists of the left camera, rotation first, T(t + dt) = T(t)
Exp(dt v): a static point moves through the camera frame as p(t + dt) = Exp(-dt v) p(t).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import checked_positive_definite
from factors.stereo import Camera, as_camera
from gpvo.config import McRansacConfig
from gpvo.mc_ransac.fast import fast_mc_ransac
from gpvo.mc_ransac.iterative import VelocityFit, iterative_mc_ransac
from gpvo.mc_ransac.segments import Segments, are_inliers

Array = NDArray[np.float64]


def mc_ransac(
    segments: Segments,
    camera: Camera,
    information: ArrayLike,
    config: McRansacConfig,
    rng: np.random.Generator | int,
    trusted: NDArray[np.bool_] | None = None,
) -> VelocityFit | None:
    """Find the largest set of segments that one velocity explains, and that velocity.

    The fast version proposes an inlier set, the iterative version refines it. `information` is the
    inverse covariance R^-1 of a measurement, (3, 3) or its diagonal (3,); `rng` draws the samples,
    or is a seed. They are drawn and judged among the `trusted` (N,) segments, or all. Returns None
    if no sample has enough inliers, or if they do not determine a velocity.

    Raises
    ------
    ValueError
        If the information is not symmetric and positive definite, or `rng` is neither a seed, an
        integer from 0, nor a generator.
    """
    information = checked_positive_definite("information", information, 3)
    camera = as_camera(camera)
    proposing = segments if trusted is None else segments[trusted]
    if len(proposing) < config.sample_size:
        return None
    velocity = fast_mc_ransac(proposing, camera, config, rng)
    inliers = are_inliers(segments, camera, velocity, config)
    if inliers.sum() < config.sample_size:
        return None
    return iterative_mc_ransac(segments, camera, information, velocity, inliers, config)
