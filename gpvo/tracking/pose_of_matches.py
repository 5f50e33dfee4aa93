"""The pose of a camera that measures known points, wherever it is, some of them wrongly.

Three right matches determine it (RANSAC); those that agree with it refine it. Their points are as
far apart where they are measured as where they are known, which few wrong ones are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.kernels.compiled import kernel
from factors.lie import se3_exp, skew

Array = NDArray[np.float64]

SAMPLES = 4000
"""Triples of matches from which a pose is made, at most."""
DRAWS = 400_000
"""Matches that are drawn for them, at most."""
TRIES = 40
"""Matches that are drawn for one corner of a triple, at most."""
PRECISION = 1.0
"""Deviation of a measurement that is allowed when distances are compared, pixels."""
TOLERANCE = 3.0
"""Largest error of a match that agrees with a pose, pixels of (u_left, v, disparity)."""
LEAST = 10
"""Least number of matches that agree: chance matches agree in three or four."""
STEPS = 5
"""Gauss-Newton steps in which the pose is refined on the matches that agree."""


def pose_of_matches(
    camera: StereoCamera, points: Array, measured: Array, least: int = LEAST
) -> Array | None:
    """Find the pose (4, 4) in which points (N, 3) are measured, (N, 3); None if too few agree."""
    if len(points) < max(least, 3):
        return None
    return fitted_pose(camera, _best_of_samples(camera, points, measured), points, measured, least)


def fitted_pose(
    camera: StereoCamera, T: Array, points: Array, measured: Array, least: int = LEAST
) -> Array | None:
    """Fit a pose (4, 4) to the points (N, 3) that agree with it; None if fewer than `least` do."""
    for _ in range(STEPS):
        agree = agreeing(camera, T, points, measured)
        if agree.sum() < least:
            return None
        T = _refined(camera, T, points[agree], measured[agree])
    return T


def agreeing(camera: StereoCamera, T: Array, points: Array, measured: Array) -> NDArray[np.bool_]:
    """Tell which points (N, 3) are measured (N, 3) where a pose (4, 4) sees them."""
    return np.asarray(_agree(camera, T[None], points, measured)[0])


def jacobian_of_pose(camera: StereoCamera, T: Array, points: Array) -> tuple[Array, Array]:
    """Compute measurements (N, 3) of points, and their Jacobian of the pose, (N, 3, 6)."""
    seen = (points - T[:3, 3]) @ T[:3, :3]
    predicted, by_point = camera.project_with_jacobian(seen)
    by_twist = np.concatenate([skew(seen), -np.broadcast_to(np.eye(3), (len(seen), 3, 3))], axis=2)
    return predicted, by_point @ by_twist


def _best_of_samples(camera: StereoCamera, points: Array, measured: Array) -> Array:
    """Return the pose (4, 4) of three matches with which most agree; of points (N, 3) in start."""
    seen = camera.triangulate(measured)
    samples = _rigid_triples(camera, points, seen)
    there, here = _corners(points[samples]), _corners(seen[samples])
    T = np.tile(np.eye(4), (len(samples), 1, 1))
    T[:, :3, :3] = there @ here.transpose(0, 2, 1)
    middle = seen[samples].mean(axis=1)
    T[:, :3, 3] = points[samples].mean(axis=1) - np.einsum("nij,nj->ni", T[:, :3, :3], middle)
    return np.asarray(T[_agree(camera, T, points, measured).sum(axis=1).argmax()])


def _rigid_triples(camera: StereoCamera, points: Array, seen: Array) -> NDArray[np.int64]:
    """Draw triples (K, 3) of matches, K > 0, of points (N, 3) as far apart as they are seen."""
    fx, *_, baseline = camera.parameters
    z = seen[:, 2]
    deviation = PRECISION * np.hypot(z**2 / (fx * baseline), z / fx)
    draws = np.random.default_rng(0).integers(0, len(points), DRAWS)
    triples = _rigid_triples_kernel(points, seen, deviation, draws)
    return triples if len(triples) else np.array([[0, 1, 2]])


@kernel
def _rigid_triples_kernel(
    points: Array, seen: Array, deviation: Array, draws: NDArray[np.int64]
) -> NDArray[np.int64]:
    triples = np.empty((SAMPLES, 3), np.int64)
    count = corners = tries = 0
    for match in draws:
        if count == SAMPLES:
            break
        fits = True
        for corner in triples[count, :corners]:
            apart = np.sqrt(np.sum((points[match] - points[corner]) ** 2))
            apart_seen = np.sqrt(np.sum((seen[match] - seen[corner]) ** 2))
            tolerance = np.hypot(deviation[match], deviation[corner])
            fits &= apart > 0 and abs(apart - apart_seen) < tolerance
        tries += 1
        if fits:
            triples[count, corners] = match
            corners, tries = corners + 1, 0
        if corners == 3:
            count, corners = count + 1, 0
        if tries == TRIES:
            corners, tries = 0, 0
    return triples[:count]


def _corners(triangles: Array) -> Array:
    """Right-handed frames (N, 3, 3) of triangles (N, 3 corners, 3); zero for those without area."""
    along, other = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = np.cross(along, other)
    axes = np.stack([along, np.cross(normal, along), normal], axis=2)
    return axes / np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-12)


def _agree(camera: StereoCamera, T: Array, points: Array, measured: Array) -> NDArray[np.bool_]:
    """Tell which points (N, 3) are measured (N, 3) where poses (K, 4, 4) see them, as (K, N)."""
    return _agree_kernel(T, points, measured, camera.parameters)


@kernel
def _agree_kernel(
    T_start_cam: Array, points: Array, measured: Array, camera: Array
) -> NDArray[np.bool_]:
    fx, fy, cx, cy, baseline = camera
    agree = np.zeros((len(T_start_cam), len(points)), np.bool_)
    for k in range(len(T_start_cam)):
        R, t = T_start_cam[k, :3, :3], T_start_cam[k, :3, 3]
        for n in range(len(points)):
            a, b, c = points[n, 0] - t[0], points[n, 1] - t[1], points[n, 2] - t[2]
            z = R[0, 2] * a + R[1, 2] * b + R[2, 2] * c
            if z > 0:
                u = fx * (R[0, 0] * a + R[1, 0] * b + R[2, 0] * c) / z + cx - measured[n, 0]
                v = fy * (R[0, 1] * a + R[1, 1] * b + R[2, 1] * c) / z + cy - measured[n, 1]
                d = fx * baseline / z - measured[n, 2]
                agree[k, n] = u * u + v * v + d * d < TOLERANCE**2
    return agree


def _refined(camera: StereoCamera, T: Array, points: Array, measured: Array) -> Array:
    """Take one Gauss-Newton step of a pose, perturbed on the right."""
    predicted, jacobian = jacobian_of_pose(camera, T, points)
    step, *_ = np.linalg.lstsq(jacobian.reshape(-1, 6), (measured - predicted).ravel(), rcond=None)
    return np.asarray(T @ se3_exp(step))
