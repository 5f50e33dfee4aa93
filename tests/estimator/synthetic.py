"""Tracklets of a synthetic motion, every measurement at a time of its own."""

from __future__ import annotations

import numpy as np

from factors import StereoCamera
from factors.lie import se3_exp, se3_inverse
from gpvo.tracking import Measurements

CAMERA = StereoCamera(200.0, 200.0, 173.0, 130.0, 0.1)
TWIST = np.array([0.1, -0.2, 0.15, 0.3, -0.1, 0.4])


def constant_velocity(t: np.ndarray, twist: np.ndarray = TWIST) -> np.ndarray:
    """Poses (N, 4, 4) at times t (N,), the identity at t = 0."""
    return se3_exp(np.asarray(t)[:, None] * twist)


def tracklets(
    clusters: int = 5,
    per_cluster: int = 7,
    noise: float = 0.0,
    seed: int = 0,
    period: float = 0.05,
    twist: np.ndarray = TWIST,
) -> list[Measurements]:
    """Measurements by cluster, of landmarks that are seen in four clusters at random times."""
    rng = np.random.default_rng(seed)
    landmark = np.arange(per_cluster * (clusters + 3))
    first = landmark // per_cluster - 3
    stereo = rng.uniform([40, 40, 5], [300, 220, 20], (len(landmark), 3))
    T_birth = constant_velocity((first + 0.5) * period, twist)
    local = CAMERA.triangulate(stereo)
    world = np.einsum("nij,nj->ni", T_birth[:, :3, :3], local) + T_birth[:, :3, 3]
    result = []
    for cluster in range(clusters):
        seen = np.flatnonzero((first <= cluster) & (cluster < first + 4))
        t = np.round((cluster + rng.random(len(seen))) * period, 6)
        T_cam_world = se3_inverse(constant_velocity(t, twist))
        points = np.einsum("nij,nj->ni", T_cam_world[:, :3, :3], world[seen])
        measured = CAMERA.project(points + T_cam_world[:, :3, 3])
        measured += noise * rng.standard_normal(measured.shape)
        result.append(Measurements(landmark[seen], np.full(len(seen), cluster), t, measured))
    return result
