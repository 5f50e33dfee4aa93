"""A window of states as a GTSAM problem, every landmark and every state a variable of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray

from factors import StereoCamera, gauss_newton_parameters, isam2_parameters, optimize
from gpvo.estimator.dead_reckoning import DeadReckoning
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import graph_of, insert_states
from gpvo.estimator.isam2 import joint_covariance, states_of
from gpvo.estimator.state_times import SAME_TIME
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
NO_CHANGE = 1e-9
"""Change of the cost that says nothing, whatever its share: measurements agree but for rounding."""
SMALLEST_PART = 8
"""States that are eliminated in order of time, not halved further."""


@dataclass(frozen=True, eq=False)
class Window:
    """States 0 to K - 1 and the measurements between the first and the last of them.

    Attributes
    ----------
    states
        Times, and the poses and twists to begin with.
    measurements
        Of landmarks that are measured at least twice.
    first_covariance
        (12, 12) of the first state's pose and twist, for its priors.
    reckoning
        How the motion goes on where nothing measures it.
    """

    states: States
    measurements: Measurements
    first_covariance: Array
    reckoning: DeadReckoning = field(default_factory=lambda: DeadReckoning(0.0))

    def graph(self, build: GraphBuilder) -> gtsam.NonlinearFactorGraph:
        """Make the priors on the first state, WNOA priors, and reprojection factors."""
        numbers, states = range(len(self.states)), self.states
        density = self.reckoning.densities(states.t, build.qc)
        first = states.T_world_cam[0], states.twist[0], self.first_covariance
        return graph_of(
            (
                *build.prior_on_first_state(0, *first),
                *build.motion(numbers, states.t, density),
                *self.reckoning.at_rest(numbers, states.t),
                *build.reprojection(numbers, states.t, self.measurements),
            )
        )

    def values(self, build: GraphBuilder) -> gtsam.Values:
        """Return the states, and landmarks triangulated from them."""
        values = gtsam.Values()
        insert_states(values, range(len(self.states)), self.states)
        T_at_measurement, _ = self.states.query(self.measurements.t)
        for landmark, point in landmark_points(self.measurements, T_at_measurement, build.camera):
            values.insert(L(landmark), point)
        return values

    def optimize(self, build: GraphBuilder) -> States:
        """Return the states that minimise the cost, by Gauss-Newton as in the paper.

        Raises
        ------
        RuntimeError
            If the measurements do not determine them.
        """
        numbers, config = range(len(self.states)), build.config
        ordering = nested_dissection(numbers, self.states.t, self.measurements)
        parameters = gauss_newton_parameters(config.iterations, config.relative_decrease)
        parameters.setAbsoluteErrorTol(NO_CHANGE)
        try:
            values = optimize(self.graph(build), self.values(build), parameters, ordering)
        except ValueError as error:
            raise RuntimeError(str(error)) from error
        return states_of(values, numbers, self.states.t)

    def covariance(self, build: GraphBuilder, count: int) -> Array:
        """Return the (12 count, 12 count) covariance of the first states."""
        solved = gtsam.ISAM2(isam2_parameters(relinearize_threshold=0.0))
        solved.update(self.graph(build), self.values(build))
        return joint_covariance(solved, range(count))


def landmark_points(
    measurements: Measurements, T_world_cam: Array, camera: StereoCamera
) -> Iterator[tuple[int, Array]]:
    """Yield each landmark and its point in the world, from its nearest measurement.

    T_world_cam (N, 4, 4) are the poses at the measurements' times.
    """
    order = np.lexsort((-measurements.stereo[:, 2], measurements.landmark))
    landmarks, first = np.unique(measurements.landmark[order], return_index=True)
    nearest = order[first]
    points = camera.triangulate(measurements.stereo[nearest])
    T = T_world_cam[nearest]
    world = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
    yield from zip(landmarks.tolist(), world, strict=True)


def nested_dissection(
    states: Sequence[int], t: Array, measurements: Measurements
) -> gtsam.Ordering:
    """Return an elimination order that halves the time axis again and again.

    A landmark stands behind the last state that separates its measurements. On windows of some
    thousand states COLAMD's fronts are several times as large.
    """
    before = np.clip(np.searchsorted(t, measurements.t + SAME_TIME, "right") - 1, 0, None)
    landmarks, which = np.unique(measurements.landmark, return_inverse=True)
    first, last = np.full(len(landmarks), len(t)), np.full(len(landmarks), -1)
    np.minimum.at(first, which, before)
    np.maximum.at(last, which, before)
    ordering = gtsam.Ordering()

    def dissect(start: int, stop: int, inside: NDArray[np.int64]) -> None:
        if stop - start <= SMALLEST_PART:
            for k in range(start, stop):
                push_state(k)
        else:
            middle = (start + stop) // 2
            left, right = last[inside] < middle, first[inside] > middle
            dissect(start, middle, inside[left])
            dissect(middle + 1, stop, inside[right])
            push_state(middle)
            inside = inside[~left & ~right]
        for landmark in landmarks[inside].tolist():
            ordering.push_back(L(landmark))

    def push_state(k: int) -> None:
        ordering.push_back(V(states[k]))
        ordering.push_back(X(states[k]))

    dissect(0, len(t), np.arange(len(landmarks)))
    return ordering
