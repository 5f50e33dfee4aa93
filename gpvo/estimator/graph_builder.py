"""The factor graph of section III-C: WNOA priors between states, reprojection factors of landmarks.

State k has the keys X(k), its Pose3 T_world_cam, and V(k), its body twist; landmark l is the Point3
L(l) in the world.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray

from factors import (
    InterpolatedStereoFactor,
    StereoCamera,
    StereoReprojectionFactor,
    StructurelessStereoFactor,
    WnoaPriorFactor,
)
from gpvo.config.stages import NoiseConfig
from gpvo.estimator.robust import RobustLoss
from gpvo.tracking.measurements import Measurements

Array = NDArray[np.float64]
SAME_TIME = 5e-7
"""Seconds; times nearer than this, half the resolution of event stamps, are one state."""


@dataclass(frozen=True)
class FactorMaker:
    """Makes the factors of one camera with one set of noise parameters."""

    camera: StereoCamera
    noise: NoiseConfig
    loss: RobustLoss = field(default_factory=RobustLoss)

    def anchor(
        self, state: int, T_world_cam: Array, twist: Array, covariance: Array
    ) -> list[gtsam.NonlinearFactor]:
        """Priors on a state, with a covariance (12, 12) of pose and twist without correlation."""
        of_pose = gtsam.noiseModel.Gaussian.Covariance(covariance[:6, :6])
        of_twist = gtsam.noiseModel.Gaussian.Covariance(covariance[6:, 6:])
        return [
            gtsam.PriorFactorPose3(X(state), gtsam.Pose3(T_world_cam), of_pose),
            gtsam.PriorFactorVector(V(state), twist, of_twist),
        ]

    def motion(self, states: Sequence[int], t: Array) -> list[gtsam.NonlinearFactor]:
        """WNOA prior between each state and the next; t (K,) are their times, seconds."""
        qc = np.array(self.noise.acceleration_psd)
        return [
            WnoaPriorFactor(X(i), V(i), X(j), V(j), dt, qc)
            for i, j, dt in zip(states[:-1], states[1:], np.diff(t), strict=True)
        ]

    def reprojection(
        self, states: Sequence[int], t: Array, measurements: Measurements
    ) -> list[gtsam.NonlinearFactor]:
        """A factor for each measurement, at the state of its time or between two states.

        The measurements' times must lie within those of the states, t (K,), up to `SAME_TIME`.
        """
        model = self.loss.noise_model(np.diag(self.noise.measurement_information))
        before = np.clip(np.searchsorted(t, measurements.t + SAME_TIME, "right") - 1, 0, None)
        factors: list[gtsam.NonlinearFactor] = []
        for k, time, landmark, stereo in zip(
            before.tolist(),
            measurements.t.tolist(),
            measurements.landmark.tolist(),
            measurements.stereo,
            strict=True,
        ):
            point = L(landmark)
            if time - t[k] <= SAME_TIME:
                at_state = StereoReprojectionFactor(stereo, model, X(states[k]), point, self.camera)
                factors.append(at_state)
                continue
            i, j = states[k], states[k + 1]
            keys, times = (X(i), V(i), X(j), V(j), point), (t[k], t[k + 1], time)
            factors.append(InterpolatedStereoFactor(stereo, model, *keys, self.camera, *times))
        return factors

    def structureless(
        self, states: Sequence[int], t: Array, measurements: Measurements
    ) -> gtsam.NonlinearFactor:
        """One factor of all measurements, their landmarks eliminated; arguments as above."""
        return StructurelessStereoFactor(
            measurements.stereo,
            np.clip(measurements.t, t[0], t[-1]),
            measurements.landmark,
            self.loss.noise_model(np.diag(self.noise.measurement_information)),
            [(X(k), V(k), time) for k, time in zip(states, t.tolist(), strict=True)],
            self.camera,
        )


def state_times(t: Array, interval: float, after: float = -np.inf) -> Array:
    """Increasing times of states: those of t (N,) that follow the last one by `interval` or more.

    Only times beyond `after` are taken, by as much, and always the latest; times nearer than
    `SAME_TIME` are one.
    """
    kept: list[float] = []
    for time in np.unique(t).tolist():
        if time - after > max(interval, SAME_TIME):
            kept.append(time)
            after = time
        elif time == t.max() and time - after > SAME_TIME:
            kept.append(time)
    return np.array(kept)


def landmark_points(
    measurements: Measurements, T_world_cam: Array, camera: StereoCamera
) -> Iterator[tuple[int, Array]]:
    """Each landmark and its point in the world, triangulated from its nearest measurement.

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
    """Elimination order that halves the time axis again and again.

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


SMALLEST_PART = 8
"""States that are eliminated in order of time, not halved further."""
