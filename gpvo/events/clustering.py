"""Event clustering: synchronous stereo windows, surfaces of active events, binary frames.

Section III-A.1 of the paper.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpvo.array_table import ArrayTable
from gpvo.config import ClusteringConfig
from gpvo.events.contours import events_until_thick
from gpvo.events.noise_filter import EventFilter
from gpvo.recordings import Events, StereoEvents, StereoRig


@dataclass(frozen=True, eq=False)
class RectifiedEvents(ArrayTable):
    """Events of one camera in order of time, at their rectified pixels.

    Attributes
    ----------
    points
        (N, 2) float64 rectified pixel (u, v), within the image.
    t
        (N,) float64 seconds since the recording's start.
    polarity
        (N,) bool, True where the pixel became brighter.
    """

    points: NDArray[np.float64]
    t: NDArray[np.float64]
    polarity: NDArray[np.bool_]

    @staticmethod
    def empty() -> RectifiedEvents:
        """Return a table without events."""
        return RectifiedEvents(np.empty((0, 2)), np.empty(0), np.empty(0, bool))


@dataclass(frozen=True, eq=False)
class ClusterEvents:
    """The events of one camera in one cluster, on the rectified pixel grid.

    Attributes
    ----------
    surface_of_active_events
        (height, width) float64 time of the latest event of each pixel, seconds; -inf where none.
    event_count
        Number of events in the cluster, including those that rectify to outside the image.
    events
        Function that returns the rectified events, for trackers that process them one by one.
    """

    surface_of_active_events: NDArray[np.float64]
    event_count: int
    events: Callable[[], RectifiedEvents] = RectifiedEvents.empty

    @property
    def binary_frame(self) -> NDArray[np.uint8]:
        """Image (height, width) that is 255 at pixels with an event of either polarity, else 0."""
        return np.where(np.isfinite(self.surface_of_active_events), 255, 0).astype(np.uint8)

    def time_surface(self, start: float, stop: float) -> NDArray[np.uint8]:
        """Compute the image (height, width) of the latest event times, 0 at pixels without events.

        The value grows linearly from 1 at `start` to 255 at `stop`.
        """
        age = (self.surface_of_active_events - start) / (stop - start)
        level = np.rint(1 + 254 * np.clip(age, 0, 1))
        return np.where(np.isfinite(age), level, 0).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class StereoCluster:
    """Left and right events of the same interval [start, stop), in seconds."""

    start: float
    stop: float
    left: ClusterEvents
    right: ClusterEvents


def cluster_events(
    batches: Iterable[StereoEvents], rig: StereoRig, config: ClusteringConfig
) -> Iterator[StereoCluster]:
    """Cut a stereo event stream into clusters.

    A cluster ends after `config.window` seconds, or as soon as either camera has
    `config.max_events` events or contours `config.max_thickness` pixels thick. The last cluster is
    dropped if the stream fills less than half of it.
    """

    def cluster(start: float, stop: float) -> StereoCluster:
        images = [
            rectified_cluster(events.between(start, stop), table, rig.resolution)
            for events, table in zip((left, right), rig.tables, strict=True)
        ]
        return StereoCluster(start, stop, *images)

    left, right = Events.empty(), Events.empty()
    filter_left = EventFilter(rig.left.resolution, config)
    filter_right = EventFilter(rig.right.resolution, config)
    start = end = None
    for batch in batches:
        start, end = batch.start if start is None else start, batch.stop
        left = Events.concatenate([left, filter_left(batch.left)])
        right = Events.concatenate([right, filter_right(batch.right)])
        while (stop := _cluster_end((left, right), rig, start, config)) <= batch.stop:
            yield cluster(start, stop)
            left, right = left.between(stop, np.inf), right.between(stop, np.inf)
            start = stop
    if start is None or end is None:
        return
    filled_by_time = (end - start) / config.window
    filled_by_events = max(len(left), len(right)) / config.max_events
    if max(filled_by_time, filled_by_events) >= 0.5:
        yield cluster(start, end)


def _cluster_end(
    sides: tuple[Events, Events], rig: StereoRig, start: float, config: ClusteringConfig
) -> float:
    """Return the end of the cluster that begins at `start`, in seconds.

    If events fill the cluster before its window ends, it ends just after the event that fills it.
    """
    stop = start + config.window
    for events, camera in zip(sides, (rig.left, rig.right), strict=True):
        full = config.max_events
        if config.max_thickness > 0:
            first = events[:full]
            thick = events_until_thick(first.x, first.y, camera.resolution, config.max_thickness)
            full = min(full, thick)
        if len(events) >= full:
            stop = min(stop, float(np.nextafter(events.t[full - 1], np.inf)))
    return stop


def rectified_cluster(
    events: Events, table: NDArray[np.float32], resolution: tuple[int, int]
) -> ClusterEvents:
    """Rectify events to the nearest pixel and keep the latest time of each pixel.

    `table` (height, width, 2) holds the rectified pixel of every raw pixel; `resolution` is
    (width, height) of the rectified image.
    """
    surface = np.full(resolution[::-1], -np.inf)
    _paint(surface, events.x, events.y, events.t, table)
    return ClusterEvents(surface, len(events), partial(rectify, events, table, resolution))


def rectify(
    events: Events, table: NDArray[np.float32], resolution: tuple[int, int]
) -> RectifiedEvents:
    """Rectify events and drop those outside the image; parameters like `rectified_cluster`."""
    points, inside = np.empty((len(events), 2)), np.empty(len(events), np.bool_)
    _rectify(events.x, events.y, table, resolution, points, inside)
    return RectifiedEvents(points[inside], events.t[inside], events.polarity[inside])


@njit(cache=True, nogil=True)
def _rectify(
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    table: NDArray[np.float32],
    resolution: tuple[int, int],
    points: NDArray[np.float64],
    inside: NDArray[np.bool_],
) -> None:
    width, height = resolution
    for i in range(len(x)):
        u, v = table[y[i], x[i]]
        points[i] = u, v
        inside[i] = 0 <= np.rint(u) < width and 0 <= np.rint(v) < height  # some tables hold NaN


@njit(cache=True, nogil=True)
def _paint(
    surface: NDArray[np.float64],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: NDArray[np.float64],
    table: NDArray[np.float32],
) -> None:
    height, width = surface.shape
    for i in range(len(t)):
        u, v = table[y[i], x[i]]
        column, row = np.rint(u), np.rint(v)
        if 0 <= column < width and 0 <= row < height:  # as floats: some tables hold NaN
            surface[int(row), int(column)] = t[i]
