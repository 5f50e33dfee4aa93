"""Windows of states, and measurements of landmarks at unique times between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import gtsam
import numpy as np
from graphs import CAMERA
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from factors import (
    LandmarkPrior,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    wnoa_square_root_covariance,
)
from factors.lie import se3_exp, se3_inverse, se3_log, se3_right_jacobian

Array = NDArray[np.float64]
Index = NDArray[np.int64]

PERIOD = 0.05
TWIST = np.array([0.1, -0.2, 0.15, 0.3, -0.1, 0.4])
QC = np.array([0.2, 0.2, 0.2, 0.5, 0.5, 0.5])  # deviations between states as large as the noise
NOISE = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.1, 0.15, 0.2]))
TIGHT = gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)


@dataclass(frozen=True)
class Window:
    """States X(k), V(k) every 50 ms, and measurements in order of time, all times unique.

    Attributes
    ----------
    t_states
        (m,) seconds.
    measured, t, landmark
        (n, 3), (n,) and (n,).
    points
        (L, 3) in the world.
    t_all, T_all, v_all
        (N,), (N, 4, 4) and (N, 6) the motion at all times of states and measurements.
    """

    t_states: Array
    measured: Array
    t: Array
    landmark: Index
    points: Array
    t_all: Array
    T_all: Array
    v_all: Array

    @staticmethod
    def simulated(
        count: int = 5,
        landmarks: int = 20,
        seen: int = 8,
        noise: float = 0.0,
        qc: Array | None = None,
        twist: Array = TWIST,
        seed: int = 0,
    ) -> Window:
        """Landmarks seen at random times within three periods, by a camera of a mean twist.

        With `qc` the motion is a sample of the process, else of constant twist. `noise` is in
        units of the noise model's.
        """
        rng = np.random.default_rng(seed)
        t_states: Array = np.linspace(0.0, PERIOD * (count - 1), count)
        end = t_states[-1]
        landmark = np.repeat(np.arange(landmarks), seen)
        begin = rng.uniform(-2 * PERIOD, end - PERIOD, landmarks)
        t: Array = np.round(begin[landmark] + 3 * PERIOD * rng.uniform(size=len(landmark)), 7)
        inside = (t >= 0) & (t < end) & ~np.isin(t, t_states)
        order = np.argsort(t[inside])
        t, landmark = t[inside][order], landmark[inside][order]
        t_all = np.union1d(t_states, t)
        T_all, v_all = _motion(t_all, twist, qc, rng)
        stereo = np.column_stack(
            [*rng.uniform(40, 260, (2, landmarks)), rng.uniform(5, 16, landmarks)]
        )
        T_birth = se3_exp(begin[:, None] * twist)
        points = moved_points(T_birth, CAMERA.triangulate(stereo))
        measured = CAMERA.project(
            moved_points(se3_inverse(T_all[t_all.searchsorted(t)]), points[landmark])
        )
        measured += noise * rng.normal(size=measured.shape) * NOISE.sigmas()
        return Window(t_states, measured, t, landmark, points, t_all, T_all, v_all)

    @property
    def count(self) -> int:
        """Number of states."""
        return len(self.t_states)

    @property
    def states(self) -> list[tuple[int, int, float]]:
        """Keys and times for a factor."""
        return [(X(k), V(k), t) for k, t in enumerate(self.t_states.tolist())]

    @property
    def truth(self) -> gtsam.Values:
        """The motion at the states."""
        at = self.t_all.searchsorted(self.t_states)
        return values_of(self.T_all[at], self.v_all[at])

    def only(self, keep: NDArray[np.bool_]) -> Window:
        """Return the window with some of its measurements (n,)."""
        some = {name: getattr(self, name)[keep] for name in ("measured", "t", "landmark")}
        return replace(self, **some)

    def factor(
        self,
        first: int = 0,
        qc: Array | None = None,
        prior: LandmarkPrior | None = None,
        tolerance: float = 1e-14,
        model: Any = NOISE,
    ) -> StructurelessStereoFactor:
        """Factor of what is measured from the state number `first` on."""
        stay = self.t >= self.t_states[first]
        data = self.measured[stay], self.t[stay], self.landmark[stay]
        states = self.states[first:]
        return StructurelessStereoFactor(*data, model, states, CAMERA, qc, prior, tolerance)

    def later(self, first: int) -> Index:
        """Landmarks that are measured from the state number `first` on."""
        return np.unique(self.landmark[self.t >= self.t_states[first]])

    def chain(self, first: int, last: int, qc: Array = QC) -> gtsam.NonlinearFactorGraph:
        """Motion priors from the state `first` to `last`; where it is the first, what holds it."""
        return chain(self.t_states, first, last, self.truth, qc)


def chain(
    t: Array, first: int, last: int, held: gtsam.Values, qc: Array = QC
) -> gtsam.NonlinearFactorGraph:
    """Motion priors between the states X(k), V(k) at times t; the very first is held."""
    graph = gtsam.NonlinearFactorGraph()
    if first == 0:
        graph.push_back(gtsam.PriorFactorPose3(X(0), held.atPose3(X(0)), TIGHT))
        loose = gtsam.noiseModel.Isotropic.Sigma(6, 1.0)
        graph.push_back(gtsam.PriorFactorVector(V(0), held.atVector(V(0)), loose))
    for i, j in pairwise(range(first, last + 1)):
        graph.push_back(WnoaPriorFactor(X(i), V(i), X(j), V(j), float(t[j] - t[i]), qc))
    return graph


def values_of(T: Array, v: Array) -> gtsam.Values:
    """States X(k), V(k)."""
    values = gtsam.Values()
    for k in range(len(T)):
        values.insert(X(k), gtsam.Pose3(T[k]))
        values.insert(V(k), v[k])
    return values


def keys(first: int, last: int) -> list[int]:
    """Pose and velocity of the states from `first` to before `last`."""
    return [key for k in range(first, last) for key in (X(k), V(k))]


def graph_of(*parts: Any) -> gtsam.NonlinearFactorGraph:
    """One graph of factors and graphs."""
    graph = gtsam.NonlinearFactorGraph()
    for part in parts:
        graph.push_back(part)
    return graph


def mean_and_covariance(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, keys: list[int]
) -> tuple[Array, Array]:
    """Gauss-Newton's step (D,) and the covariance (D, D), by QR of the whole Jacobian."""
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(key)
    J, b = graph.linearize(values).jacobian(ordering)
    inverse = np.linalg.inv(np.linalg.qr(J, mode="r"))
    covariance = inverse @ inverse.T
    return covariance @ (J.T @ b), covariance


def in_sigmas(found: Array, expected: Array, covariance: Array) -> float:
    """Largest difference of means, in standard deviations."""
    return float((np.abs(found - expected) / np.sqrt(np.diag(covariance))).max())


def of_correlations(found: Array, expected: Array) -> float:
    """Largest difference of covariances, in products of standard deviations."""
    sigmas = np.sqrt(np.diagonal(expected, axis1=-2, axis2=-1))
    return float((np.abs(found - expected) / (sigmas[..., None] * sigmas[..., None, :])).max())


def retracted(values: gtsam.Values, step: Array, keys: list[int]) -> gtsam.Values:
    """Values moved by a step (6 K,), poses on the right."""
    delta = gtsam.VectorValues()
    for n, key in enumerate(keys):
        delta.insert(key, step[6 * n : 6 * n + 6])
    return values.retract(delta)


def moved_world(values: gtsam.Values, S: Array) -> gtsam.Values:
    """All poses seen from another world."""
    moved = gtsam.Values(values)
    for key in list(values.keys()):
        if gtsam.Symbol(key).chr() == ord("x"):
            moved.update(key, gtsam.Pose3(S @ values.atPose3(key).matrix()))
    return moved


def local_step(T: Array, v: Array, T_other: Array, v_other: Array) -> Array:
    """(..., 12) from states to others."""
    return np.concatenate([se3_log(se3_inverse(T) @ T_other), v_other - v], axis=-1)


def _motion(
    t: Array, twist: Array, qc: Array | None, rng: np.random.Generator
) -> tuple[Array, Array]:
    if qc is None:
        return se3_exp(t[:, None] * twist), np.repeat(twist[None], len(t), axis=0)
    T, v = np.empty((len(t), 4, 4)), np.empty((len(t), 6))
    T[0], v[0] = np.eye(4), twist
    for k, dt in enumerate(np.diff(t).tolist()):
        noise = wnoa_square_root_covariance(dt, qc) @ rng.normal(size=12)
        xi, rate = dt * v[k] + noise[:6], v[k] + noise[6:]
        T[k + 1], v[k + 1] = T[k] @ se3_exp(xi), se3_right_jacobian(xi) @ rate
    return T, v


def moved_points(T: Array, points: Array) -> Array:
    return np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
