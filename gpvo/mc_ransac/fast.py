"""Fast MC-RANSAC, section III-B.1: random samples, each with the velocity that fits it best."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.stereo import StereoCamera
from gpvo.config import McRansacConfig
from gpvo.mc_ransac.fast_kernels import best_sample_velocity, distinct_indices
from gpvo.mc_ransac.segments import Segments, inlier_tolerance

Array = NDArray[np.float64]


def fast_mc_ransac(
    segments: Segments, camera: StereoCamera, config: McRansacConfig, rng: np.random.Generator | int
) -> Array:
    """Find the velocity (6,) of the random sample that explains most segments, section III-B.1.

    `rng` draws the samples, or is a seed.

    Raises
    ------
    ValueError
        If there are fewer segments than a sample has.
    """
    if len(segments) < config.sample_size:
        raise ValueError(f"segments must be {config.sample_size} or more, not {len(segments)}")
    points = camera.triangulate(segments.earlier)
    displacements = camera.triangulate(segments.later) - points
    return best_sample_velocity(
        points,
        displacements,
        segments.dt,
        segments.later,
        inlier_tolerance(segments, config),
        random_samples(
            len(segments), config.sample_size, config.iterations, np.random.default_rng(rng)
        ),
        camera.parameters,
        config.confidence,
    )


def random_samples(
    count: int, size: int, iterations: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Draw indices (iterations, size) below `count`, uniform and distinct within a row."""
    return distinct_indices(rng.random((iterations, size)), count)
