"""Tracklets of landmarks, measured at the times of their own events, and their filters.

Section III-A.2 of the paper.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.config import TrackletConfig
from gpvo.events import ClusterEvents, StereoCluster
from gpvo.tracking.measurements import Measurements
from gpvo.tracking.observations import Observations

Array = NDArray[np.float64]

BREAK = 0.5
"""Time between two clusters after which no constant velocity is assumed, seconds."""
LEAST_LANDMARKS = 8
"""Number of landmarks below which the image speed is unknown."""


class Tracklets:
    """Measurements of the latest clusters that passed the filters of single measurements.

    `earlier_frames` is the number of earlier clusters to which new observations may belong: their
    events are kept for the measurements' times.

    `out_of_bounds` is the number of those added last that did not pass.
    """

    def __init__(self, config: TrackletConfig, earlier_frames: int) -> None:
        self._config = config
        self._clusters: deque[tuple[int, StereoCluster]] = deque(maxlen=earlier_frames + 1)
        self._shown: deque[int] = deque(maxlen=config.history)
        self._cluster_count = self._unbroken = 0
        self._measurements = Measurements.concatenate([])
        self._taken = np.empty(0, bool)
        self._passed: NDArray[np.int64] | None = None  # what `_long_enough` found, while it holds
        self.out_of_bounds = 0

    def add(self, cluster: StereoCluster, observations: Observations) -> None:
        """Add the observations of a new cluster, which lie in it or in earlier clusters.

        Clusters that show nothing, as in a gap of the events, do not count as history.
        """
        if not self._clusters or cluster.start - self._clusters[-1][1].stop > BREAK:
            self._unbroken = self._cluster_count
            self._taken[:] = True  # what is given after the break begins after it
        newest = self._cluster_count
        self._clusters.append((newest, cluster))
        self._cluster_count += 1
        latest = self._shown[-1] if self._shown else -1
        self._shown.extend(np.unique(observations.frame[observations.frame > latest]).tolist())
        if newest in observations.frame:
            self._keep(self._measurements.frame >= self._shown[0])
        frames = {newest, *observations.frame.tolist()}
        shown = [(number, shown) for number, shown in self._clusters if number in frames]
        new = [self._measure(*one, observations) for one in shown]
        given = np.isin(observations.frame, [number for number, _ in shown])
        self.out_of_bounds = int(given.sum()) - sum(map(len, new))
        self._measurements = Measurements.concatenate([self._measurements, *new])
        self._passed = None
        self._taken = np.append(self._taken, np.zeros(sum(map(len, new)), bool))

    def pairs(self, span: int) -> tuple[Measurements, Measurements]:
        """Return pairs of an earlier and the newest measurement of the same landmarks, (N,) each.

        The newest is in the newest cluster. The earlier is the first of its landmark in that
        cluster and the `span` clusters before it that show any, since the latest break; a pair
        needs two different times.
        """
        newest, known, index = self._cluster_count - 1, self._measurements, self._long_enough()
        oldest = max(min([*self._shown][-(span + 1) :], default=newest), self._unbroken)
        index = index[known.frame[index] >= oldest]
        later = index[known.frame[index] == newest]
        earlier = index[_run_starts(known.landmark[index])]
        earlier = earlier[np.searchsorted(known.landmark[earlier], known.landmark[later])]
        apart = known.t[later] > known.t[earlier]
        return known[earlier[apart]], known[later[apart]]

    def image_speed(self) -> float | None:
        """Return the speed of the slow landmarks between the two newest clusters, pixels/s.

        It is the lower quartile: far landmarks need time to show, while near ones rush by. None for
        fewer than LEAST_LANDMARKS landmarks.
        """
        newest, known = self._cluster_count - 1, self._measurements
        before, now = (np.flatnonzero(known.frame == number) for number in (newest - 1, newest))
        common = np.intersect1d(known.landmark[before], known.landmark[now], return_indices=True)
        before, now = before[common[1]], now[common[2]]
        dt = known.t[now] - known.t[before]
        before, now, dt = before[dt > 0], now[dt > 0], dt[dt > 0]
        if len(dt) < LEAST_LANDMARKS:
            return None
        way = np.linalg.norm(known.stereo[now, :2] - known.stereo[before, :2], axis=1)
        return float(np.percentile(way / dt, 25))

    def too_short(self) -> int:
        """Count the landmarks of the newest cluster that were seen before, but not for long."""
        newest = self._measurements.frame == self._cluster_count - 1
        landmark = self._measurements.landmark
        again = np.isin(landmark[newest], landmark[~newest])
        return int((again & ~np.isin(landmark[newest], landmark[self._long_enough()])).sum())

    def take(self, inliers: NDArray[np.int64]) -> Measurements:
        """Take the measurements of the landmarks `inliers` that were not taken before."""
        index = self._long_enough()
        index = index[np.isin(self._measurements.landmark[index], inliers) & ~self._taken[index]]
        self._taken[index] = True
        return self._measurements[index]

    def reject(self, outliers: NDArray[np.int64]) -> None:
        """Remove the measurements of the landmarks `outliers` in the newest cluster."""
        newest = self._measurements.frame == self._cluster_count - 1
        self._keep(~(newest & np.isin(self._measurements.landmark, outliers)))

    def _keep(self, mask: NDArray[np.bool_]) -> None:
        self._measurements, self._taken = self._measurements[mask], self._taken[mask]
        self._passed = None

    def _long_enough(self) -> NDArray[np.int64]:
        """Return the indices of measurements whose tracklets pass the length and duration filters.

        They are in order of landmark, then of time. The length of a tracklet is the distance
        between its first and its last left image point.
        """
        if self._passed is not None:
            return self._passed
        known = self._measurements
        order = np.lexsort((known.t, known.landmark))
        first = _run_starts(known.landmark[order])
        after = np.append(first, len(order))[1:]
        start, end = order[first], order[after - 1]
        motion = known.stereo[end, :2] - known.stereo[start, :2]
        duration = known.t[end] - known.t[start]
        passed = np.linalg.norm(motion, axis=1) >= self._config.min_length
        passed &= duration >= self._config.min_duration
        self._passed = order[np.repeat(passed, after - first)]
        return self._passed

    def _measure(
        self, number: int, cluster: StereoCluster, observations: Observations
    ) -> Measurements:
        """Assign times to the observations of one cluster and apply the stereo filters."""
        seen = observations.frame == number
        left, right = observations.left[seen], observations.right[seen]
        disparity = observations.disparity[seen]
        t_left, t_right = (
            self._times(image, points, own)
            for image, points, own in zip(
                (cluster.left, cluster.right),
                (left, right),
                observations.times[seen].T,
                strict=True,
            )
        )
        passed = np.abs(t_left - t_right) <= self._config.max_stereo_time_difference
        passed &= disparity >= self._config.min_disparity
        return Measurements(
            observations.landmark[seen],
            observations.frame[seen],
            t_left,
            np.column_stack([left, disparity]),
            observations.deviations[seen],
        )[passed]

    def _times(self, image: ClusterEvents, points: Array, own: Array) -> Array:
        """Return the times (N,) of points (N, 2): the tracker's own, else those of the surface."""
        times, unknown = own.copy(), ~np.isfinite(own)
        if unknown.any():
            surface, radius = image.surface_of_active_events, self._config.time_radius
            times[unknown] = feature_times(surface, points[unknown], radius)
        return times


def _run_starts(ordered: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return where each run of equal numbers (N,) begins."""
    return np.flatnonzero(np.append(True, np.diff(ordered) != 0)[: len(ordered)])


@kernel
def feature_times(
    surface: NDArray[np.float64], points: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    """Compute the times (N,) of features at points (N, 2) from a surface of active events.

    The surface is (height, width). The time of a feature is the mean of the events' times within
    `radius` pixels. It is the time of the nearest event if the radius is 0 or contains no event,
    and NaN if the surface is empty.
    """
    times = np.empty(len(points))
    for i in range(len(points)):
        times[i] = _mean_time(surface, points[i, 0], points[i, 1], radius)
        if np.isnan(times[i]):
            times[i] = _nearest_time(surface, points[i, 0], points[i, 1])
    return times


@kernel
def _mean_time(surface: NDArray[np.float64], u: float, v: float, radius: float) -> float:
    height, width = surface.shape
    total, count = 0.0, 0
    if radius == 0:
        return np.nan
    for row in range(max(0, int(np.ceil(v - radius))), min(height - 1, int(v + radius)) + 1):
        for column in range(max(0, int(np.ceil(u - radius))), min(width - 1, int(u + radius)) + 1):
            near = (row - v) ** 2 + (column - u) ** 2 <= radius**2
            if near and surface[row, column] > -np.inf:
                total += surface[row, column]
                count += 1
    return total / count if count else np.nan


@kernel
def _nearest_time(surface: NDArray[np.float64], u: float, v: float) -> float:
    """Return the time of the event nearest to (u, v), searched in growing squares."""
    height, width = surface.shape
    centre_column, centre_row = int(np.rint(u)), int(np.rint(v))
    best, nearest = np.nan, np.inf
    for ring in range(max(height, width) + 1):
        if ring - 1 > nearest:
            break
        for row in range(centre_row - ring, centre_row + ring + 1):
            edge = abs(row - centre_row) == ring
            step = 1 if edge else max(1, 2 * ring)
            for column in range(centre_column - ring, centre_column + ring + 1, step):
                if not (0 <= row < height and 0 <= column < width):
                    continue
                distance = np.hypot(row - v, column - u)
                if surface[row, column] > -np.inf and distance < nearest:
                    best, nearest = surface[row, column], distance
    return best
