"""The fixed-lag smoother as one would write it with GTSAM, nothing eliminated beforehand.

Key states at the clusters' ends, every landmark a Point3 that stays for as long as it is measured
within the lag, and a factor for each measurement at its own time, between two key states. It is
slow, and all that it knows is in GTSAM's graph: what the estimator is compared with.
"""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray

from benchmarks.simulated_tracklets import TrackletSimulation
from factors import InterpolatedStereoFactor, StereoCamera, WnoaPriorFactor
from factors.lie import se3_inverse, se3_log
from gpvo.config import NoiseConfig
from gpvo.mc_ransac import VelocityFit
from gpvo.tracking import Measurements
from gpvo.trajectory import States

Array = NDArray[np.float64]
FIXED = 1e-6
"""Standard deviation of the first pose, rad and m."""
BEYOND_LAG = 1e-6
"""Seconds by which the lag is longer, so that a state at its end stays."""


class ReferenceSmoother:
    """Estimates key states and landmarks by gtsam.IncrementalFixedLagSmoother.

    `lag` is in seconds; between two clusters' ends key states are `interval` seconds apart or less,
    and each update takes `steps` steps of Gauss-Newton.
    """

    def __init__(
        self,
        camera: StereoCamera,
        noise: NoiseConfig,
        lag: float,
        interval: float = np.inf,
        steps: int = 1,
    ) -> None:
        self._camera, self._noise, self._interval, self._steps = camera, noise, interval, steps
        self._model = gtsam.noiseModel.Gaussian.Information(np.diag(noise.measurement_information))
        parameters, method = gtsam.ISAM2Params(), gtsam.ISAM2GaussNewtonParams()
        method.setWildfireThreshold(0.0)
        parameters.setOptimizationParams(method)
        parameters.setFactorization("QR")
        parameters.setRelinearizeThreshold(0.0)
        parameters.relinearizeSkip = 1
        parameters.findUnusedFactorSlots = True
        self._smoother = gtsam.IncrementalFixedLagSmoother(lag + BEYOND_LAG, parameters)
        # While Python holds it, GTSAM does not copy all values for each factor written in Python.
        self._linearization_point = self._smoother.getLinearizationPoint()
        self._factors: list[gtsam.NonlinearFactor] = []
        self.states = States()
        """All key states, each as it was estimated last."""

    def update(
        self,
        end_time: float,
        measurements: Measurements,
        velocity_estimate: VelocityFit | None = None,
    ) -> None:
        """Take the measurements that a cluster added."""
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        stamps: dict[int, float] = {}
        if len(self.states) == 0:
            if len(measurements) == 0:
                return
            self._begin(graph, float(measurements.t.min()))
        before = len(self.states)
        self._extend(graph, end_time)
        for k in range(0 if before == 1 else before, len(self.states)):
            values.insert(X(k), gtsam.Pose3(self.states.T_world_cam[k]))
            values.insert(V(k), self.states.twist[k])
            stamps[X(k)] = stamps[V(k)] = float(self.states.t[k])
        self._measure(graph, values, stamps, measurements)
        self._smoother.update(graph, values, stamps)
        for _ in range(self._steps - 1):
            self._smoother.update()
        self._read(self._smoother.calculateEstimate())

    def _begin(self, graph: gtsam.NonlinearFactorGraph, t: float) -> None:
        """Make the first state, whose pose defines the world."""
        self.states = States(np.array([t]), np.eye(4)[None], np.zeros((1, 6)))
        pose, twist = FIXED, self._noise.initial_velocity
        isotropic = gtsam.noiseModel.Isotropic.Sigma
        graph.push_back(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), isotropic(6, pose)))
        graph.push_back(gtsam.PriorFactorVector(V(0), np.zeros(6), isotropic(6, twist)))

    def _extend(self, graph: gtsam.NonlinearFactorGraph, end_time: float) -> None:
        """Add key states up to a cluster's end, at constant velocity."""
        start = float(self.states.t[-1])
        count = max(1, int(np.ceil((end_time - start) / self._interval - 1e-6)))
        t = np.linspace(start, end_time, count + 1)[1:]
        first = len(self.states) - 1
        self.states = States.concatenate([self.states, self.states.at(t, self.states.twist[-1])])
        for i, dt in enumerate(np.diff(self.states.t[first:]), first):
            keys = X(i), V(i), X(i + 1), V(i + 1)
            self._push(graph, WnoaPriorFactor(*keys, dt, self._noise.acceleration_psd))

    def _measure(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        stamps: dict[int, float],
        measurements: Measurements,
    ) -> None:
        """Add a factor for each measurement in the window, and the landmarks that are new."""
        measurements = measurements[measurements.t >= self._window_start]
        t, T_at = self.states.t, self.states.query(measurements.t)[0]
        before = np.clip(np.searchsorted(t, measurements.t, "right") - 1, 0, len(t) - 2)
        points = self._camera.triangulate(measurements.stereo)
        for n, (i, landmark) in enumerate(
            zip(before.tolist(), measurements.landmark.tolist(), strict=True)
        ):
            key, time = L(landmark), float(measurements.t[n])
            keys = X(i), V(i), X(i + 1), V(i + 1), key
            measured = measurements.stereo[n], self._model, *keys, self._camera
            self._push(graph, InterpolatedStereoFactor(*measured, t[i], t[i + 1], time))
            stamps[key] = max(time, stamps.get(key, time))
            if not (self._linearization_point.exists(key) or values.exists(key)):
                values.insert(key, T_at[n, :3, :3] @ points[n] + T_at[n, :3, 3])

    @property
    def _window_start(self) -> float:
        """Time of the first key state that has not left."""
        known = (k for k in range(len(self.states)) if self._linearization_point.exists(X(k)))
        return float(self.states.t[next(known, 0)])

    def _push(self, graph: gtsam.NonlinearFactorGraph, factor: gtsam.NonlinearFactor) -> None:
        graph.push_back(factor)
        self._factors.append(factor)

    def _read(self, estimate: gtsam.Values) -> None:
        """Take over the key states that have not left."""
        for k in reversed(range(len(self.states))):
            if not estimate.exists(X(k)):
                break
            self.states.T_world_cam[k] = estimate.atPose3(X(k)).matrix()
            self.states.twist[k] = estimate.atVector(V(k))


def with_revisits(
    clusters: list[tuple[float, Measurements]], stretch: int = 3
) -> list[tuple[float, Measurements]]:
    """Clusters whose landmarks are measured in every second stretch of them only."""
    kept = []
    for number, (end_time, part) in enumerate(clusters):
        phase = part.landmark * 7919 % (2 * stretch)
        kept.append((end_time, part[(number + phase) // stretch % 2 == 0]))
    return kept


def long_tracks(
    seed: int, length: int, per_cluster: int, duration: float, revisits: bool = False
) -> tuple[TrackletSimulation, States, list[tuple[float, Measurements]]]:
    """A simulation, its motion, and clusters of landmarks that are measured in `length` of them."""
    noise, rng = NoiseConfig(initial_velocity=0.3, track_drift=0.0), np.random.default_rng(seed)
    simulation = TrackletSimulation(noise, per_cluster, length, disparity=(20.0, 40.0))
    motion = simulation.motion(duration, rng)
    clusters = list(simulation.clusters(motion, rng))
    return simulation, motion, with_revisits(clusters) if revisits else clusters


def position_errors(states: States, motion: States, t: Array) -> Array:
    """(N,) distance from the true position at times t (N,), m."""
    T, _ = states.query(t)
    T_true, _ = motion.query(t)
    start, _ = motion.query(states.t[:1])
    error = se3_log(se3_inverse(T) @ se3_inverse(start) @ T_true)
    return np.linalg.norm(error[:, 3:], axis=1)
