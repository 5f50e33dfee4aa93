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
        If there are fewer segments than a sample has, or `rng` is neither of them.
    """
    generator = _generator(rng)
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
        random_samples(len(segments), config.sample_size, config.iterations, generator),
        camera.parameters,
        config.confidence,
    )


def _generator(rng: np.random.Generator | int) -> np.random.Generator:
    if isinstance(rng, np.random.Generator):
        return rng
    if not isinstance(rng, int | np.integer) or rng < 0:
        raise ValueError(f"rng must be a seed, an integer from 0, or a Generator, not {rng!r}")
    return np.random.default_rng(rng)


def random_samples(
    count: int, size: int, iterations: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Draw indices (iterations, size) below `count`, uniform and distinct within a row."""
    return distinct_indices(rng.random((iterations, size)), count)
