"""A fixed-lag smoother fed with stereo measurements that come one by one.

GTSAM's incremental smoother keeps a window of states, one every 20 ms; each measurement enters at
its own time, between two states. Run as ``python -m examples.fixed_lag_smoother``.
"""

from __future__ import annotations

from collections.abc import Iterator

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray

from factors import InterpolatedStereoFactor, StereoCamera, WnoaPriorFactor, extrapolate
from factors.lie import se3_inverse, se3_log

Array = NDArray[np.float64]
Measurement = tuple[float, int, Array]  # seconds, number of the landmark, (u_left, v, disparity)

CAMERA = StereoCamera(fx=226.0, fy=226.0, cx=173.0, cy=130.0, baseline=0.1)
TWIST = np.array([0.1, 0.2, 0.1, 0.2, 0.1, 0.3])  # the true motion, rad/s and m/s
QC = np.array([0.02, 0.02, 0.02, 0.2, 0.2, 0.2])
PIXELS = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.3, 0.3, 0.3]))
STEP, LAG, STATES = 0.02, 0.2, 30
LANDMARKS, PER_STEP = 20, 12


def measurements(rng: np.random.Generator) -> Iterator[list[Measurement]]:
    """What is measured in each step of 20 ms, in order of time."""
    points = np.column_stack([rng.uniform(-1.5, 1.5, (LANDMARKS, 2)), rng.uniform(2, 5, LANDMARKS)])
    for k in range(STATES):
        times = np.sort(rng.uniform(k * STEP, (k + 1) * STEP, PER_STEP)).round(6)
        numbers = rng.integers(LANDMARKS, size=PER_STEP)
        homogeneous = np.column_stack([points[numbers], np.ones(PER_STEP)])[..., None]
        in_camera = se3_inverse(extrapolate(np.eye(4), TWIST, times).pose) @ homogeneous
        noise = rng.normal(size=(PER_STEP, 3)) * PIXELS.sigmas()
        measured = CAMERA.project(in_camera[:, :3, 0]) + noise
        yield list(zip(times.tolist(), numbers.tolist(), measured, strict=True))


class Odometry:
    """The newest state (pose, velocity), and what the next update of the smoother brings."""

    def __init__(self) -> None:
        self.pose, self.velocity, self.k = np.eye(4), np.zeros(6), 0
        self.smoother = make_smoother()
        # While Python holds it, GTSAM does not copy all values for each factor written in Python.
        self.linearization_point = self.smoother.getLinearizationPoint()
        self.start_update()
        self.add_state(0, self.pose, 0.0)
        tight, loose = (gtsam.noiseModel.Isotropic.Sigma(6, sigma) for sigma in (1e-4, 1.0))
        self.graph.add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), tight))
        self.graph.add(gtsam.PriorFactorVector(V(0), np.zeros(6), loose))

    def start_update(self) -> None:
        """Nothing new yet."""
        self.graph, self.values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self.stamps: dict[int, float] = {}

    def add_state(self, k: int, pose: Array, t: float) -> None:
        """State k, about where the motion so far leads."""
        self.values.insert(X(k), gtsam.Pose3(pose))
        self.values.insert(V(k), self.velocity)
        self.stamps |= {X(k): t, V(k): t}

    def step(self, measured: list[Measurement]) -> Array:
        """Pose (4, 4) of the next state, 20 ms on, with what was measured until then."""
        i, j = self.k, self.k + 1
        self.add_state(j, extrapolate(self.pose, self.velocity, STEP).pose, j * STEP)
        self.graph.add(WnoaPriorFactor(X(i), V(i), X(j), V(j), STEP, QC))
        for measurement in measured:
            self.add_measurement(*measurement)
        self.smoother.update(self.graph, self.values, self.stamps)
        self.smoother.update()
        self.start_update()
        self.pose = self.smoother.calculateEstimatePose3(X(j)).matrix()
        self.velocity, self.k = self.smoother.calculateEstimateVector(V(j)), j
        return self.pose

    def add_measurement(self, t: float, n: int, measured: Array) -> None:
        """A measurement of landmark n at its own time, between the newest states."""
        i, j = self.k, self.k + 1
        keys = X(i), V(i), X(j), V(j), L(n)
        times = i * STEP, j * STEP, t
        self.graph.add(InterpolatedStereoFactor(measured, PIXELS, *keys, CAMERA, *times))
        self.stamps[L(n)] = j * STEP  # keeps the landmark in the window
        if not (self.linearization_point.exists(L(n)) or self.values.exists(L(n))):
            ahead = extrapolate(self.pose, self.velocity, t - i * STEP).pose
            self.values.insert(L(n), (ahead @ np.r_[CAMERA.triangulate(measured), 1.0])[:3])


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
    odometry = Odometry()
    poses = np.array([odometry.step(each) for each in measurements(np.random.default_rng(0))])
    truth = extrapolate(np.eye(4), TWIST, STEP * np.arange(1, STATES + 1)).pose
    errors = se3_log(se3_inverse(poses) @ truth)
    largest = np.linalg.norm(errors[:, 3:], axis=1).max()
    print(f"{STATES} states, largest position error {1e3 * largest:.1f} mm")
    return errors


if __name__ == "__main__":
    main()
