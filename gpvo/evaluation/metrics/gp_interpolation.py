"""Interpolation of poses by the white-noise-on-acceleration (WNOA) Gaussian process.

Linear interpolation cuts the corners of a sparse ground truth. The process passes through the same
poses smoothly; along a straight line it is the natural cubic spline.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solveh_banded

from factors.interpolation import interpolate
from factors.lie import se3_log, se3_right_jacobian_inverse
from gpvo.evaluation.metrics.paper_errors import steps
from gpvo.trajectory import StampedPoses


def interpolate_by_gp(poses: StampedPoses, stamps_ns: ArrayLike) -> StampedPoses:
    """Interpolate at increasing stamps: the most probable poses under the WNOA prior.

    Raises
    ------
    InputError
        If there are fewer than two poses, or a stamp lies before the first or after the last.
    """
    query = np.asarray(stamps_ns, np.int64)
    poses.require_cover(query)
    velocities = most_probable_velocities(poses)
    seconds, at = poses.seconds, (query - poses.stamps_ns[0]) * 1e-9
    j = np.clip(np.searchsorted(seconds, at, side="right"), 1, len(poses) - 1)
    i = j - 1
    T = poses.T_world_cam
    state = interpolate(T[i], velocities[i], T[j], velocities[j], seconds[i], seconds[j], at)
    return StampedPoses(query, state.pose)


def most_probable_velocities(poses: StampedPoses) -> NDArray[np.float64]:
    """Compute the body twists (N, 6), rotation first, that minimise the WNOA cost of exact poses.

    For a step of length h and twist xi, with local velocities x and y at its start and end, the
    cost is 4/h (|x|^2 + x.y + |y|^2) - 12/h^2 xi.(x + y) plus a constant. The normal equations are
    linear and block tridiagonal, since a step couples neighbouring poses only.
    """
    twists = se3_log(steps(poses.T_world_cam))
    to_local = se3_right_jacobian_inverse(twists)
    h = np.diff(poses.seconds)[:, None, None]
    diagonal = np.zeros((len(poses), 6, 6))
    diagonal[:-1] += 2.0 / h * np.eye(6)
    diagonal[1:] += 2.0 / h * (np.swapaxes(to_local, 1, 2) @ to_local)
    right = np.zeros((len(poses), 6))
    right[:-1] += 3.0 / h[:, 0] ** 2 * twists
    right[1:] += 3.0 / h[:, 0] ** 2 * np.einsum("kji,kj->ki", to_local, twists)
    bands = _upper_bands(diagonal, to_local / h)
    return solveh_banded(bands, right.ravel()).reshape(-1, 6)


def _upper_bands(diagonal: NDArray[np.float64], above: NDArray[np.float64]) -> NDArray[np.float64]:
    """Store a symmetric block tridiagonal matrix, 6 x 6 blocks, in LAPACK's banded form."""
    bands = np.zeros((12, 6 * len(diagonal)))
    for row in range(6):
        for column in range(6):
            if column >= row:
                bands[11 + row - column, column::6] = diagonal[:, row, column]
            bands[5 + row - column, 6 + column :: 6] = above[:, row, column]
    return bands
