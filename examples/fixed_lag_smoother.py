"""A fixed-lag smoother fed with stereo measurements that come one by one.

GTSAM's incremental smoother keeps a window of states, one every 20 ms; each measurement enters at
its own time, between two states. Run as ``python -m examples.fixed_lag_smoother``.
"""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray

from factors import InterpolatedStereoFactor, StereoCamera, WnoaPriorFactor, extrapolate
from factors.lie import se3_inverse, se3_log

Array = NDArray[np.float64]

CAMERA = StereoCamera(fx=226.0, fy=226.0, cx=173.0, cy=130.0, baseline=0.1)
TWIST = np.array([0.1, 0.2, 0.1, 0.2, 0.1, 0.3])  # the true motion, rad/s and m/s
QC = np.array([0.02, 0.02, 0.02, 0.2, 0.2, 0.2])
PIXELS = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.3, 0.3, 0.3]))
STEP, LAG, STATES = 0.02, 0.2, 30
LANDMARKS, PER_STEP = 20, 12


def make_smoother() -> gtsam.IncrementalFixedLagSmoother:
    """QR, and relinearisation at every update: chains that are close in time are stiff."""
    parameters = gtsam.ISAM2Params()
    parameters.setFactorization("QR")
    parameters.setRelinearizeThreshold(1e-3)
    parameters.relinearizeSkip = 1
    parameters.findUnusedFactorSlots = True
    return gtsam.IncrementalFixedLagSmoother(LAG, parameters)


def main() -> Array:
    """Errors (n, 6) of the newest state at each update, against the true motion."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1.5, 1.5, (LANDMARKS, 2)), rng.uniform(2, 5, LANDMARKS)])
    smoother = make_smoother()
    # While Python holds it, GTSAM does not copy all its values for each factor written in Python.
    linearization_point = smoother.getLinearizationPoint()
    tight = gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)
    loose = gtsam.noiseModel.Isotropic.Sigma(6, 1.0)
    graph = gtsam.NonlinearFactorGraph()
    graph.add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), tight))
    graph.add(gtsam.PriorFactorVector(V(0), np.zeros(6), loose))
    pose, velocity, known = np.eye(4), np.zeros(6), set()
    values, stamps = gtsam.Values(), {X(0): 0.0, V(0): 0.0}
    values.insert(X(0), gtsam.Pose3())
    values.insert(V(0), velocity)
    errors = []
    for k in range(STATES):
        i, j = k, k + 1
        t_i, t_j = i * STEP, j * STEP
        graph.add(WnoaPriorFactor(X(i), V(i), X(j), V(j), STEP, QC))
        ahead = extrapolate(pose, velocity, STEP)
        values.insert(X(j), gtsam.Pose3(ahead.pose))
        values.insert(V(j), velocity)
        stamps |= {X(j): t_j, V(j): t_j}
        for t in np.sort(rng.uniform(t_i, t_j, PER_STEP)).round(6):
            n = int(rng.integers(LANDMARKS))
            true_pose = extrapolate(np.eye(4), TWIST, t).pose
            in_camera = (se3_inverse(true_pose) @ np.r_[points[n], 1.0])[:3]
            measured = CAMERA.project(in_camera) + rng.normal(size=3) * PIXELS.sigmas()
            states = X(i), V(i), X(j), V(j)
            graph.add(
                InterpolatedStereoFactor(measured, PIXELS, *states, L(n), CAMERA, t_i, t_j, t)
            )
            stamps[L(n)] = t_j  # keeps the landmark in the window
            if n not in known:
                seen = np.r_[CAMERA.triangulate(measured), 1.0]
                values.insert(L(n), (extrapolate(pose, velocity, t - t_i).pose @ seen)[:3])
                known.add(n)
        smoother.update(graph, values, stamps)
        smoother.update()
        graph, values, stamps = gtsam.NonlinearFactorGraph(), gtsam.Values(), {}
        known = {n for n in known if linearization_point.exists(L(n))}
        pose = smoother.calculateEstimatePose3(X(j)).matrix()
        velocity = smoother.calculateEstimateVector(V(j))
        errors.append(se3_log(se3_inverse(pose) @ extrapolate(np.eye(4), TWIST, t_j).pose))
    print(
        f"{STATES} states, largest position error "
        f"{1e3 * np.linalg.norm(np.array(errors)[:, 3:], axis=1).max():.1f} mm"
    )
    return np.array(errors)


if __name__ == "__main__":
    main()
