"""Landmarks searched around where the motion has them, which has drifted since they were seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.tracking.klt.anchors import Anchors, match_anchors
from gpvo.tracking.klt.lucas_kanade import Pyramid

Array = NDArray[np.float64]
Points = NDArray[np.float32]

LEAST_DRIFTED = 5
"""Least number of landmarks found alike away from their places that tell of a drift."""
WIDELY = 8
"""Most landmarks that are searched widely in a frame: those that were lost first drifted most."""
REACH = np.float32(5.0)
"""Distance of the starts of a wide search, pixels: a match is found from some three away."""
AROUND = REACH * np.array([[u, v] for u in (-1, 0, 1) for v in (-1, 0, 1) if u or v], np.float32)
"""Where it starts, relative to where a landmark is expected."""


def match_drifted(
    anchors: Anchors,
    warps: Array,
    image: Pyramid,
    expected: Points,
    tolerance: float,
    least_correlation: float,
) -> tuple[Points, Array]:
    """Match one or more anchors under their warps (N, 3, 2) with an image, around points (N, 2).

    Landmarks are found within the tolerance, pixels, or farther away if that many others are as far
    away in the same direction: there the motion has drifted. Returns the points in the image (N, 2)
    and the correlation (N,) of the patches, -1 for those that are not found.
    """
    left, alike = match_anchors(anchors, warps, image, expected)
    alike[_length(left - expected) >= tolerance] = -1.0
    missed = np.flatnonzero(alike < least_correlation)[:WIDELY]
    if len(missed) >= LEAST_DRIFTED:
        given = anchors[missed], warps[missed], image, expected[missed], AROUND
        left[missed], alike[missed] = _best(*given, left[missed], alike[missed])
    together = _together(left - expected, alike >= least_correlation, tolerance)
    most = together[together.sum(axis=1).argmax()]
    if most.sum() >= LEAST_DRIFTED:
        drift = np.median((left - expected)[most], axis=0)[None]
        left, alike = _best(anchors, warps, image, expected, drift, left, alike)
        together = _together(left - expected, alike >= least_correlation, tolerance)
    near = _length(left - expected) < tolerance
    return left, np.where(near | (together.sum(axis=1) >= LEAST_DRIFTED), alike, -1.0)


def _best(
    anchors: Anchors,
    warps: Array,
    image: Pyramid,
    expected: Points,
    starts: Points,
    left: Points,
    alike: Array,
) -> tuple[Points, Array]:
    """Return the best matches (N, 2) from starts beside, and their correlations, or those given."""
    for start in starts:
        there, correlation = match_anchors(anchors, warps, image, expected + start)
        better = correlation > alike
        left = np.where(better[:, None], there, left)
        alike = np.where(better, correlation, alike)
    return left, alike


def _together(drift: Points, known: NDArray[np.bool_], tolerance: float) -> NDArray[np.bool_]:
    """Tell which known landmarks drifted (N, 2) as each one did, (N, N)."""
    return np.asarray((_length(drift[:, None] - drift[None]) < tolerance) & known)


def _length(ways: Points) -> Array:
    return np.asarray(np.linalg.norm(ways, axis=-1))
