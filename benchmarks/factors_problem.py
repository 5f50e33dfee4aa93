"""The standard problem of the factors' benchmarks, as factors of GTSAM's own and of ours."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray

from factors import (
    StereoCamera,
    StereoReprojectionFactor,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    interpolate,
)
from factors.lie import se3_exp, se3_inverse

Array = NDArray[np.float64]
Factors = list[gtsam.NonlinearFactor]


CAMERA = StereoCamera(226.0, 226.0, 173.0, 130.0, 0.1)
NATIVE_CAMERA = gtsam.Cal3_S2Stereo(226.0, 226.0, 0.0, 173.0, 130.0, 0.1)
QC = 1 / (50 * np.array([10.0, 10, 10, 1, 1, 1]))  # the paper's, rotation first
SIGMAS = 1 / np.sqrt(0.1 * np.array([5.0, 5, 1]))  # of (u_left, v, disparity), the paper's
NOISE = gtsam.noiseModel.Diagonal.Sigmas(SIGMAS)
ROBUST = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(1.345), NOISE)
_MIX = np.array([[1.0, 0, 0], [1, 0, -1], [0, 1, 0]])  # (u_left, u_right, v)
NATIVE_NOISE = gtsam.noiseModel.Gaussian.Covariance(_MIX @ np.diag(SIGMAS**2) @ _MIX.T)


@dataclass
class Problem:
    """Noisy stereo measurements of landmarks from a moving camera, with a start to solve from."""

    times: Array
    truth: Array
    velocities: Array
    landmark: NDArray[np.int64]
    measured: Array
    points: Array
    start: gtsam.Values = field(default_factory=gtsam.Values)


def standard_problem(
    states: int, interval: float = 5e-3, seen: int = 5, active: int = 5, seed: int = 0
) -> Problem:
    """One measurement at each of `states` unique times about an interval (seconds) apart.

    Each landmark is seen `seen` times; `active` landmarks take turns.
    """
    rng = np.random.default_rng(seed)
    times = np.cumsum(interval * rng.uniform(0.4, 1.6, states)).round(6)
    truth, velocities = np.empty((states, 4, 4)), np.empty((states, 6))
    T, v = np.eye(4), np.array([0.1, 0.2, 0.05, 0.3, 0.1, 0.2])
    for k in range(states):
        truth[k], velocities[k] = T, v
        dt = times[min(k + 1, states - 1)] - times[k]
        v = v + rng.normal(size=6) * np.sqrt(QC * dt)
        T = T @ se3_exp(dt * v)
    group, turn = np.divmod(np.arange(states), seen * active)
    landmark = group * active + turn % active
    points = np.empty((landmark.max() + 1, 3))
    measured = np.empty((states, 3))
    for k, n in enumerate(landmark):
        if k == np.flatnonzero(landmark == n)[0]:
            ray = np.r_[rng.uniform(-0.6, 0.6, 2), 1.0] * rng.uniform(1.5, 5)
            points[n] = (truth[k] @ np.r_[ray, 1.0])[:3]
        seen_from = (se3_inverse(truth[k]) @ np.r_[points[n], 1.0])[:3]
        measured[k] = CAMERA.project(seen_from) + rng.normal(size=3) * SIGMAS * 0.5
    measured[:, 2] = np.maximum(measured[:, 2], 0.5)
    problem = Problem(times, truth, velocities, landmark, measured, points)
    for k in range(states):
        problem.start.insert(X(k), gtsam.Pose3(truth[k] @ se3_exp(rng.normal(size=6) * 0.01)))
        problem.start.insert(V(k), velocities[k] + rng.normal(size=6) * 0.05)
    for n, point in enumerate(points):
        problem.start.insert(L(n), point + rng.normal(size=3) * 0.05)
    return problem


def anchor(problem: Problem) -> Factors:
    """Priors on the first state, where all agree."""
    model = gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)
    return [
        gtsam.PriorFactorPose3(X(0), gtsam.Pose3(problem.truth[0]), model),
        gtsam.PriorFactorVector(V(0), problem.velocities[0], model),
    ]


def native_factors(problem: Problem) -> Factors:
    """GTSAM's own factors with a state at each measurement."""
    data = [gtsam.StateData(X(k), V(k), t) for k, t in enumerate(problem.times)]
    motion = [gtsam.WnoaMotionFactorPose3(i, j, QC) for i, j in pairwise(data)]
    return [*anchor(problem), *motion, *(native_stereo(problem, k) for k in range(len(data)))]


def native_stereo(problem: Problem, k: int) -> gtsam.GenericStereoFactor3D:
    u, v, disparity = problem.measured[k]
    point = gtsam.StereoPoint2(u, u - disparity, v)
    keys = X(k), L(problem.landmark[k])
    return gtsam.GenericStereoFactor3D(point, NATIVE_NOISE, *keys, NATIVE_CAMERA, False, False)


def our_factors(problem: Problem, paper: bool = False) -> Factors:
    """Ours with a state at each measurement; on request with the paper's Jacobians."""
    n = len(problem.times)
    motion = [
        WnoaPriorFactor(X(k), V(k), X(k + 1), V(k + 1), dt, QC, paper)
        for k, dt in enumerate(np.diff(problem.times))
    ]
    stereo = [
        StereoReprojectionFactor(problem.measured[k], NOISE, X(k), L(problem.landmark[k]), CAMERA)
        for k in range(n)
    ]
    return [*anchor(problem), *motion, *stereo]


def tracklet_factors(problem: Problem, stride: int) -> tuple[Factors, list[int]]:
    """Ours with a state at every stride-th time, one factor for each landmark; and those states."""
    knots, states, chain = key_states(problem, stride)
    tracklets = []
    for n in range(len(problem.points)):
        rows = np.flatnonzero(problem.landmark == n)
        if len(rows) > 1:
            measured, times = problem.measured[rows], problem.times[rows]
            tracklets.append(StructurelessStereoFactor(measured, times, n, NOISE, states, CAMERA))
    return [*chain, *tracklets], knots


def structureless_factors(
    problem: Problem, stride: int, robust: bool = False, qc: Array | None = None
) -> Factors:
    """The same with one factor for all landmarks; with Q_c every time is a state of its own."""
    _, states, chain = key_states(problem, stride)
    data = problem.measured, problem.times, problem.landmark
    return [
        *chain,
        StructurelessStereoFactor(*data, ROBUST if robust else NOISE, states, CAMERA, qc),
    ]


def native_interpolated_factors(problem: Problem, stride: int) -> Factors:
    """GTSAM's own between the same states, with landmarks and the noise of the measurements."""
    knots, states, _ = key_states(problem, stride)
    data = [gtsam.StateData(*state) for state in states]
    motion = [gtsam.WnoaMotionFactorPose3(i, j, QC) for i, j in pairwise(data)]
    stereo: Factors = []
    for k, t in enumerate(problem.times):
        i = min(int(np.searchsorted(knots, k, "right")), len(knots) - 1) - 1
        if k in knots:
            stereo.append(native_stereo(problem, k))
            continue
        at = {gtsam.StateData(X(k), V(k), t)}
        between = {data[i], data[i + 1]}
        inner = native_stereo(problem, k)
        stereo.append(gtsam.WnoaInterpFactorPose3(inner, between, at, QC, True))
    return [*anchor(problem), *motion, *stereo]


def key_states(
    problem: Problem, stride: int
) -> tuple[list[int], list[tuple[int, int, float]], Factors]:
    """Every stride-th state and the last: their numbers, keys and times, and the chain of them."""
    last = len(problem.times) - 1
    knots = [*range(0, last, stride), last]
    states = [(X(k), V(k), float(problem.times[k])) for k in knots]
    motion = [WnoaPriorFactor(*i[:2], *j[:2], j[2] - i[2], QC) for i, j in pairwise(states)]
    return knots, states, [*anchor(problem), *motion]


def as_graph(factors: Factors) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.add(factor)
    return graph


def position_error(problem: Problem, values: gtsam.Values, knots: list[int]) -> float:
    """Root mean square of the position error at all measurement times, metres."""
    T = np.array([values.atPose3(X(k)).matrix() for k in knots])
    v = np.array([values.atVector(V(k)) for k in knots])
    i = np.clip(
        np.searchsorted(knots, np.arange(len(problem.times)), "right") - 1, 0, len(knots) - 2
    )
    stamps = problem.times[knots]
    poses = interpolate(
        T[i], v[i], T[i + 1], v[i + 1], stamps[i], stamps[i + 1], problem.times
    ).pose
    return float(np.sqrt(np.mean(np.sum((poses - problem.truth)[:, :3, 3] ** 2, axis=1))))


def with_landmarks(problem: Problem, knots: list[int]) -> gtsam.Values:
    """The start's states at the knots, and its landmarks."""
    chosen = without_landmarks(problem.start, knots)
    for n in range(len(problem.points)):
        chosen.insert(L(n), problem.start.atPoint3(L(n)))
    return chosen


def without_landmarks(values: gtsam.Values, knots: list[int]) -> gtsam.Values:
    """The states at the knots only."""
    chosen = gtsam.Values()
    for k in knots:
        chosen.insert(X(k), values.atPose3(X(k)))
        chosen.insert(V(k), values.atVector(V(k)))
    return chosen
