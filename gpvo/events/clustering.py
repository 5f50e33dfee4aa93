"""Event clustering: synchronous stereo windows, surfaces of active events, binary frames.

Section III-A.1 of the paper.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpvo.array_table import ArrayTable
from gpvo.config import ClusteringConfig
from gpvo.events.cluster_length import ClusterLength
from gpvo.events.flashes import FlashDetector
from gpvo.events.noise_filter import EventFilter
from gpvo.recordings import Camera, Events, StereoEvents, StereoRig


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
    noise_rate
        Background activity of the sensor, events per pixel and second; 0 before it is known.
    noise_count
        Expected number of events among them that are background activity.
    left_out
        Numbers of events that the noise filter left out since the cluster before: background
        activity, of hot pixels.
    """

    surface_of_active_events: NDArray[np.float64]
    event_count: int
    events: Callable[[], RectifiedEvents] = RectifiedEvents.empty
    noise_rate: float = 0.0
    noise_count: float = 0.0
    left_out: tuple[int, int] = (0, 0)

    @property
    def contour_count(self) -> float:
        """Estimated number of events of contours that moved."""
        return max(0.0, self.event_count - self.noise_count)

    @property
    def coverage(self) -> float:
        """Share of the pixels with an event, from 0 to 1."""
        return float(np.isfinite(self.surface_of_active_events).mean())

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
    """Left and right events of the same interval [start, stop), in seconds.

    `flash` is the time before `start` that was left out because of a flash, seconds.
    """

    start: float
    stop: float
    left: ClusterEvents
    right: ClusterEvents
    flash: float = 0.0


def cluster_events(
    batches: Iterable[StereoEvents],
    rig: StereoRig,
    config: ClusteringConfig,
    image_speed: Callable[[], float | None] = lambda: None,
) -> Iterator[StereoCluster]:
    """Cut a stereo event stream into clusters.

    A cluster ends after `config.window` seconds, or as soon as either camera has too many events;
    see `ClusterLength`. `image_speed` returns that of the features in the clusters so far, tracked
    pixels/s, None if it is unknown. Flashes are left out. The last cluster is dropped if the stream
    fills less than half of it.
    """
    length, flashes, flash = ClusterLength(config, rig), FlashDetector(), 0.0
    sides = [
        _PendingEvents(camera, table, rig.resolution, config)
        for camera, table in zip((rig.left, rig.right), rig.tables, strict=True)
    ]
    start = end = None
    for batch in batches:
        start, end = batch.start if start is None else start, batch.stop
        for side, events in zip(sides, (batch.left, batch.right), strict=True):
            side.add(events)
        while True:
            duration, limit = length.limits(image_speed())
            stop = min(start + duration, *(side.full_at(limit) for side in sides))
            if stop > end:
                break
            left, right = (side.take(start, stop) for side in sides)
            if config.skip_flashes and flashes.is_flash(
                stop - start, max(left.coverage, right.coverage)
            ):
                flash += stop - start
            else:
                length.add(max(left.event_count, right.event_count))
                yield StereoCluster(start, stop, left, right, flash)
                flash = 0.0
            start = stop
    if start is None or end is None:
        return
    duration, limit = length.limits(image_speed())
    if max((end - start) / duration, *(len(side) / limit for side in sides)) >= 0.5:
        left, right = (side.take(start, end) for side in sides)
        yield StereoCluster(start, end, left, right, flash)


class _PendingEvents:
    """Filtered events of one camera since the latest cluster."""

    def __init__(
        self,
        camera: Camera,
        table: NDArray[np.float32],
        resolution: tuple[int, int],
        config: ClusteringConfig,
    ) -> None:
        self._table, self._resolution = table, resolution
        self._filter = EventFilter(camera.resolution, config)
        self._pixels = camera.resolution[0] * camera.resolution[1]
        self._left_out = np.zeros(2, np.int64)
        self._events = Events.empty()

    def __len__(self) -> int:
        return len(self._events)

    def add(self, events: Events) -> None:
        """Add the next events of the stream."""
        self._events = Events.concatenate([self._events, self._filter(events)])

    def full_at(self, limit: int) -> float:
        """Return the time just after so many events, seconds; inf if there are fewer."""
        if len(self._events) < limit:
            return np.inf
        return float(np.nextafter(self._events.t[limit - 1], np.inf))

    def take(self, start: float, stop: float) -> ClusterEvents:
        """Return the events before `stop`, seconds, as a cluster's, and keep the others."""
        image = rectified_cluster(
            self._events.between(-np.inf, stop), self._table, self._resolution
        )
        noise = self._filter.noise(start)
        background, hot = (self._filter.dropped - self._left_out).tolist()
        self._left_out[:] = self._filter.dropped
        self._events = self._events.between(stop, np.inf)
        return replace(
            image,
            noise_rate=noise.rate,
            noise_count=noise.passing * self._pixels * (stop - start),
            left_out=(background, hot),
        )


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
