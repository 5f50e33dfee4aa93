"""Triangulate landmarks from all their measurements and the trajectory, each at its own time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors import StereoCamera
from factors.lie import se3_inverse
from gpvo.mapping.landmark_map import LandmarkMap
from gpvo.tracking import Measurements
from gpvo.trajectory import Trajectory

Array = NDArray[np.float64]

FEWEST = 4
"""Number of measurements of a landmark that is in the map."""
LARGEST_ERROR = 3.0
"""Root mean square of a landmark's residuals, in standard deviations, above which it is no point:
an occluding edge, or two landmarks taken for one."""
LARGEST_DEVIATION = 0.1
"""Standard deviation relative to the depth above which a landmark says little."""
STEPS = 6
LEAST_INFORMATION = 1e-14
"""Relative to the largest of the three directions, below which one of them is not determined."""


def triangulate(
    trajectory: Trajectory,
    measurements: Measurements,
    camera: StereoCamera,
    information: ArrayLike,
) -> LandmarkMap:
    """Fit a point to the measurements of each landmark, given the trajectory, and keep good ones.

    Gauss-Newton over all landmarks at once, from the measurement with the largest disparity.

    Parameters
    ----------
    information
        (3,) of measurements: diagonal of R^-1, 1 / pixel^2.
    """
    inside = (measurements.t >= trajectory.start) & (measurements.t <= trajectory.stop)
    known = measurements[inside]
    known = known[np.lexsort((known.t, known.landmark))]
    number, first, of, count = np.unique(
        known.landmark, return_index=True, return_inverse=True, return_counts=True
    )
    T_cam_world = se3_inverse(trajectory.pose(known.t)) if len(known) else np.empty((0, 4, 4))
    weights = np.asarray(information, np.float64)
    position = _begin(known, T_cam_world, of, len(number), camera)
    for _ in range(STEPS):
        _, H, g, _ = _system(position, known, T_cam_world, of, camera, weights)
        H, _ = _solvable(H)
        position = position - np.linalg.solve(H, g[..., None])[..., 0]
    chi2, H, _, depth = _system(position, known, T_cam_world, of, camera, weights)
    H, determined = _solvable(H)
    last = first + count - 1
    fitted = LandmarkMap(
        number,
        position,
        np.asarray(np.linalg.inv(H), np.float64),
        count,
        known.t[first],
        known.t[last],
        np.bincount(of, depth, len(number)) / count,
    )
    return fitted[determined & _are_good(fitted, chi2 / (3 * count))]


def _solvable(H: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return H (L, 3, 3), infinite where it determines no point, and where (L,) it does.

    Landmarks whose measurements contradict each other run away to where these say nothing.
    """
    finite = np.isfinite(H).all(axis=(1, 2), keepdims=True)
    eigenvalues = np.linalg.eigvalsh(np.where(finite, H, 0.0))
    determined = eigenvalues[:, 0] > LEAST_INFORMATION * eigenvalues[:, 2]
    return np.where(determined[:, None, None], H, np.diag(np.full(3, np.inf))), determined


def _are_good(fitted: LandmarkMap, mean_chi2: Array) -> NDArray[np.bool_]:
    """Return which landmarks (N,) are points, seen often and well enough."""
    good = (fitted.measurements >= FEWEST) & (mean_chi2 < LARGEST_ERROR**2)
    good &= (fitted.depth > 0) & np.isfinite(fitted.position).all(axis=1)
    return np.asarray(good & (fitted.deviation < LARGEST_DEVIATION * fitted.depth))


def _begin(
    known: Measurements,
    T_cam_world: Array,
    of: NDArray[np.int64],
    count: int,
    camera: StereoCamera,
) -> Array:
    """Return the point (L, 3) of each landmark's measurement with the largest disparity."""
    order = np.lexsort((-known.stereo[:, 2], of))
    nearest = order[np.searchsorted(of[order], np.arange(count))]
    points = camera.triangulate(known.stereo[nearest])
    T = se3_inverse(T_cam_world[nearest])
    return np.asarray(np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3])


def _system(
    position: Array,
    known: Measurements,
    T_cam_world: Array,
    of: NDArray[np.int64],
    camera: StereoCamera,
    weights: Array,
) -> tuple[Array, Array, Array, Array]:
    """Return chi^2 (L,), H (L, 3, 3) and gradient (L, 3) of the landmarks, and depths (N,)."""
    R = T_cam_world[:, :3, :3]
    points = np.einsum("nij,nj->ni", R, position[of]) + T_cam_world[:, :3, 3]
    depth = points[:, 2].copy()
    points[:, 2] = np.maximum(depth, 1e-3)
    predicted, J = camera.project_with_jacobian(points)
    residual, J = predicted - known.stereo, J @ R
    chi2 = np.zeros(len(position))
    np.add.at(chi2, of, (residual**2 * weights).sum(axis=1))
    H, g = np.zeros((len(position), 3, 3)), np.zeros((len(position), 3))
    np.add.at(H, of, np.einsum("nki,k,nkj->nij", J, weights, J))
    np.add.at(g, of, np.einsum("nki,k,nk->ni", J, weights, residual))
    return chi2, H, g, depth
