"""Landmarks as variables of GTSAM's smoother, a factor for each measurement."""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L
from numpy.typing import NDArray

from gpvo.estimator.graph_builder import FactorMaker, landmark_points
from gpvo.estimator.graph_update import Increment, NumberedStates
from gpvo.tracking.measurements import Measurements, seen_twice
from gpvo.trajectory.states import States

Array = NDArray[np.float64]


class LandmarkVariables:
    """Landmark l is the Point3 L(l), from its second measurement on until its last is too old."""

    def __init__(self, make: FactorMaker) -> None:
        self._make = make
        self._active = gtsam.Values()
        self._pending = self.used = Measurements.concatenate([])

    def add_to(
        self, increment: Increment, window: NumberedStates, new: Measurements, leave_before: float
    ) -> None:
        """Add the factors of measurements that lie within the window, and new landmarks.

        One that leaves with this update, and is measured again, is another one with the next.
        """
        known = Measurements.concatenate([self._pending, new])
        known = known[known.t >= window.states.t[0]]
        active = np.array([self._active.exists(L(number)) for number in known.landmark], bool)
        stays = np.isin(known.landmark, self.used.landmark[self.used.t >= leave_before])
        ready = (active & stays) | (~active & np.isin(known.landmark, seen_twice(known).landmark))
        self._pending = known[~ready]
        self.used = Measurements.concatenate([self.used, known[ready]])
        self.used = self.used[self.used.t >= window.states.t[0]]
        self._measure(increment, window, known[ready])

    def add_all_to(self, increment: Increment, window: NumberedStates) -> None:
        """Add all that is used of what was measured in the window, to a smoother that is new."""
        self._active = gtsam.Values()
        self.used = self.used[self.used.t >= window.states.t[0]]
        self._measure(increment, window, self.used)

    def updated(self, estimate: gtsam.Values, states: States, added: Sequence[int]) -> None:
        """The smoother's new estimate; RuntimeError names a landmark behind a camera that saw it.

        `added` are the indices of the new factors.
        """
        used = self.used[self.used.t >= states.t[0]]
        numbers, which = np.unique(used.landmark, return_inverse=True)
        points = np.array([estimate.atPoint3(L(number)) for number in numbers.tolist()])
        T_world_cam, _ = states.query(used.t)
        rays = points.reshape(-1, 3)[which] - T_world_cam[:, :3, 3]
        behind = ~(np.einsum("ni,ni->n", rays, T_world_cam[:, :3, 2]) > 0)
        if behind.any():
            raise RuntimeError(f"landmark l{used.landmark[behind][0]} is behind the camera")
        self._active = estimate

    def _measure(
        self, increment: Increment, window: NumberedStates, measurements: Measurements
    ) -> None:
        """Reprojection factors, new landmarks, and when each was measured last."""
        T_world_cam, _ = window.states.query(measurements.t)
        for landmark, point in landmark_points(measurements, T_world_cam, self._make.camera):
            increment.stamps[L(landmark)] = self.used.t[self.used.landmark == landmark].max()
            if not self._active.exists(L(landmark)):
                increment.values.insert(L(landmark), point)
        increment.add_factors(
            self._make.reprojection(window.numbers, window.states.t, measurements)
        )
