"""Landmarks of a window, each by inverse depth in the camera frame where it was nearest."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.tracking.measurements import Measurements

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Points of the world, in coordinates that stereo measurements are nearly linear in.

    Attributes
    ----------
    number
        (L,) increasing identities.
    T_world_chart
        (L, 4, 4) fixed frames: the camera's estimated pose at the nearest measurement.
    coordinates
        (L, 3) x / z, y / z and 1 / z of the point in its frame; 1 / z > 0, and near zero for points
        that are far away.
    """

    number: Index = field(default_factory=lambda: np.empty(0, np.int64))
    T_world_chart: Array = field(default_factory=lambda: np.empty((0, 4, 4)))
    coordinates: Array = field(default_factory=lambda: np.empty((0, 3)))

    def __len__(self) -> int:
        return len(self.number)

    def __getitem__(self, index: NDArray) -> Landmarks:
        return Landmarks(self.number[index], self.T_world_chart[index], self.coordinates[index])

    @staticmethod
    def measured(measurements: Measurements, T_world_cam: Array, camera: StereoCamera) -> Landmarks:
        """The landmark of each measurement of the largest disparity, at poses (N, 4, 4)."""
        order = np.lexsort((-measurements.stereo[:, 2], measurements.landmark))
        number, first = np.unique(measurements.landmark[order], return_index=True)
        nearest = order[first]
        coordinates = camera.inverse_depth(measurements.stereo[nearest])
        return Landmarks(number, T_world_cam[nearest], coordinates)

    def and_others(self, others: Landmarks) -> Landmarks:
        """These and landmarks of other numbers."""
        order = np.argsort(np.concatenate([self.number, others.number]), kind="stable")
        both = Landmarks(
            np.concatenate([self.number, others.number]),
            np.concatenate([self.T_world_chart, others.T_world_chart]),
            np.concatenate([self.coordinates, others.coordinates]),
        )
        return both[order]

    def index(self, number: Index) -> Index:
        """Where landmarks of these numbers (N,) are; all must be there."""
        return np.searchsorted(self.number, number)

    def contains(self, number: Index) -> NDArray[np.bool_]:
        """(N,) whether landmarks of these numbers (N,) are there."""
        if len(self) == 0:
            return np.zeros(len(number), bool)
        return self.number[np.minimum(self.index(number), len(self) - 1)] == number

    def among(self, number: Index) -> NDArray[np.bool_]:
        """(L,) which of the landmarks are among these numbers (N,)."""
        among = np.zeros(len(self), bool)
        among[self.index(number[self.contains(number)])] = True
        return among

    def moved(self, step: Array) -> Landmarks:
        """With the step (L, 3) added to the coordinates."""
        return replace(self, coordinates=self.coordinates + step)

    def points(self) -> Array:
        """(L, 3) points in the world, metres."""
        ray = np.column_stack([self.coordinates[:, :2], np.ones(len(self))])
        local = ray / self.coordinates[:, 2:]
        T = self.T_world_chart
        return np.einsum("nij,nj->ni", T[:, :3, :3], local) + T[:, :3, 3]
