"""A pose graph in continuous time, built by hand from poses measured at irregular times.

The motion prior ties the states together, so the graph also estimates the velocity, and the pose at
any time in between. Run as ``python -m examples.pose_graph``.
"""

from itertools import pairwise

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from factors import InterpolatedState, WnoaPriorFactor, extrapolate, interpolate, optimize
from factors.lie import se3_exp, se3_inverse, se3_log

Array = NDArray[np.float64]

TWIST = np.array([0.2, 0.5, -0.1, 0.3, 0.1, 0.6])  # the true motion, rad/s and m/s
QC = np.full(6, 1e-3)  # power spectral density of the acceleration
SIGMAS = np.array([0.01, 0.01, 0.01, 0.02, 0.02, 0.02])  # of a measured pose, rad and m


def build(times: Array, measured: Array) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Build the graph of poses (n, 4, 4), and initial values at these poses with zero velocity."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    model = gtsam.noiseModel.Diagonal.Sigmas(SIGMAS)
    for k, pose in enumerate(measured):
        graph.add(gtsam.PriorFactorPose3(X(k), gtsam.Pose3(pose), model))
        values.insert(X(k), gtsam.Pose3(pose))
        values.insert(V(k), np.zeros(6))
    for i, j in pairwise(range(len(times))):
        graph.add(WnoaPriorFactor(X(i), V(i), X(j), V(j), times[j] - times[i], QC))
    return graph, values


def between(values: gtsam.Values, times: Array, t: Array) -> InterpolatedState:
    """Interpolate poses and velocities at any times t (m,) from those at `times` (n,)."""
    i = np.searchsorted(times, t, side="right") - 1
    T = np.array([values.atPose3(X(k)).matrix() for k in range(len(times))])
    v = np.array([values.atVector(V(k)) for k in range(len(times))])
    return interpolate(T[i], v[i], T[i + 1], v[i + 1], times[i], times[i + 1], t)


def main() -> tuple[Array, Array]:
    """Return the errors (100, 6) of poses and velocities between the measurements."""
    rng = np.random.default_rng(0)
    times = np.r_[0, np.sort(rng.uniform(0, 2, 38)), 2].round(6)
    noise = se3_exp(rng.normal(size=(40, 6)) * SIGMAS)
    values = optimize(*build(times, extrapolate(np.eye(4), TWIST, times).pose @ noise))
    t = np.linspace(0.01, 1.99, 100)
    pose, velocity, _ = between(values, times, t)
    errors = se3_log(se3_inverse(pose) @ extrapolate(np.eye(4), TWIST, t).pose)
    print(f"measured to 20 mm, known at all times to {1e3 * errors[:, 3:].std():.1f} mm")
    return errors, velocity - TWIST


if __name__ == "__main__":
    main()
