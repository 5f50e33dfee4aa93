"""Estimate the motion of a camera that sees known points: all of the estimator, and no events."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from factors import StereoCamera
from factors.lie import se3_inverse
from gpvo.config import Configuration
from gpvo.estimator import GatheredMeasurements, make_estimator, one_blas_thread
from gpvo.mc_ransac import VelocityFit
from gpvo.simulation.motion import Motion
from gpvo.tracking import Measurements

CAMERA = StereoCamera(80.0, 80.0, 60.0, 45.0, 0.1)
CLUSTERS, PERIOD = 20, 0.05
POINTS = 150
FIRST_VIEW = np.array([[10.0, 10.0, 3.0], [110.0, 80.0, 8.0]])
"""Range of (u, v, disparity) of the points, as the first camera sees them."""
NOISE = 0.1
"""Standard deviation of what is measured, pixels."""
AWAY = range(3, 15)
"""Clusters in which a third of the points are not seen: these are known again afterwards."""


def clusters(rng: np.random.Generator) -> Iterator[tuple[float, Measurements, VelocityFit]]:
    """Yield the end of each cluster, its measurements at random times, and the velocity."""
    motion = Motion.random("hand_held", CLUSTERS * PERIOD, rng)
    low, high = FIRST_VIEW
    points = CAMERA.triangulate(rng.uniform(low, high, (POINTS, 3)))
    T_first_world = se3_inverse(motion.pose(0.0))
    for frame in range(CLUSTERS):
        landmark = np.arange(POINTS // 3 if frame in AWAY else 0, POINTS)
        t = PERIOD * (frame + rng.random(len(landmark)))
        T_cam_first = se3_inverse(T_first_world @ motion.pose(t))
        turned = np.einsum("nij,nj->ni", T_cam_first[:, :3, :3], points[landmark])
        stereo = CAMERA.project(turned + T_cam_first[:, :3, 3])
        stereo += NOISE * rng.standard_normal(stereo.shape)
        frames, all_agree = np.full(len(landmark), frame), np.ones(len(landmark), bool)
        velocity = VelocityFit(motion.twist(t[:1])[0], 1e-4 * np.eye(6), all_agree)
        yield PERIOD * (frame + 1), Measurements(landmark, frames, t, stereo), velocity


def estimate_from_points(configuration: Configuration) -> None:
    """Estimate the motion, and forget it."""
    config = configuration.estimator
    estimator = make_estimator(CAMERA, configuration.noise, config)
    gathered = GatheredMeasurements(estimator, config)
    with one_blas_thread():
        for cluster in clusters(np.random.default_rng(0)):
            gathered.add(*cluster)
            estimator.latest()
            gathered.prepare()
        gathered.end()
    estimator.trajectory()
