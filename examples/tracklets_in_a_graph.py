"""Tracklets in a graph that was there before: they hold a drifting odometry.

GTSAM's own factors tie poses 50 ms apart. A velocity at each and the motion prior are all that a
StructurelessStereoFactor needs besides; its landmark stays inside. Run as
``python -m examples.tracklets_in_a_graph``.
"""

from itertools import pairwise

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X

from factors import StereoCamera, StructurelessStereoFactor, WnoaPriorFactor, extrapolate
from factors.lie import se3_inverse

CAMERA = StereoCamera(fx=226.0, fy=226.0, cx=173.0, cy=130.0, baseline=0.1)
TWIST = np.array([0.1, 0.3, -0.1, 0.2, 0.1, 0.4])  # the true motion, rad/s and m/s
QC = np.array([0.02, 0.02, 0.02, 0.2, 0.2, 0.2])  # power spectral density of the acceleration
PIXELS = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.5, 0.5, 0.7]))  # (u_left, v, disparity)
ODOMETRY = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.01, 0.01, 0.01, 0.02, 0.02, 0.02]))
STATES = [(X(k), V(k), 0.05 * k) for k in range(21)]  # pose key, velocity key, seconds


def add_odometry(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, rng: np.random.Generator
) -> None:
    """What was there before: noisy steps, and the poses that they add up to."""
    pose, tight = gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)
    graph.add(gtsam.PriorFactorPose3(X(0), pose, tight))
    values.insert(X(0), pose)
    for (pose_i, _, t_i), (pose_j, _, t_j) in pairwise(STATES):
        step = gtsam.Pose3.Expmap((t_j - t_i) * TWIST + rng.normal(size=6) * ODOMETRY.sigmas())
        graph.add(gtsam.BetweenFactorPose3(pose_i, pose_j, step, ODOMETRY))
        pose = pose.compose(step)
        values.insert(pose_j, pose)


def add_motion(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
    """A velocity at each pose, and the motion prior."""
    for (pose_i, velocity_i, t_i), (pose_j, velocity_j, t_j) in pairwise(STATES):
        graph.add(WnoaPriorFactor(pose_i, velocity_i, pose_j, velocity_j, t_j - t_i, QC))
    for _, velocity, _ in STATES:
        values.insert(velocity, np.zeros(6))


def tracklet(rng: np.random.Generator) -> StructurelessStereoFactor:
    """Ten measurements of one landmark within 0.3 s, each at its own time."""
    times = (rng.uniform(0, 0.7) + np.sort(rng.uniform(0, 0.3, 10))).round(6)
    poses = extrapolate(np.eye(4), TWIST, times).pose
    point = poses[0] @ np.r_[rng.uniform(-1, 1, 2), rng.uniform(2, 4), 1.0]
    measured = CAMERA.project((se3_inverse(poses) @ point)[:, :3])
    measured += rng.normal(size=(10, 3)) * PIXELS.sigmas()
    return StructurelessStereoFactor(measured, times, 0, PIXELS, STATES, CAMERA)


def drift(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> float:
    """Position error of the last state, metres, by GTSAM's Gauss-Newton with QR."""
    parameters = gtsam.GaussNewtonParams()
    parameters.setLinearSolverType("MULTIFRONTAL_QR")
    solved = gtsam.GaussNewtonOptimizer(graph, values, parameters).optimize()
    pose, _, t = STATES[-1]
    truth = extrapolate(np.eye(4), TWIST, t).pose[:3, 3]
    return float(np.linalg.norm(solved.atPose3(pose).translation() - truth))


def main() -> tuple[float, float]:
    """Position errors after a second: of the odometry by itself, and with 60 tracklets."""
    graph, values, rng = gtsam.NonlinearFactorGraph(), gtsam.Values(), np.random.default_rng(0)
    add_odometry(graph, values, rng)
    alone = drift(graph, values)
    add_motion(graph, values)
    for _ in range(60):
        graph.add(tracklet(rng))
    held = drift(graph, values)
    print(f"the odometry is off by {1e3 * alone:.0f} mm, with tracklets by {1e3 * held:.0f} mm")
    return alone, held


if __name__ == "__main__":
    main()
