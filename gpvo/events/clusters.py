"""Clusters of events, and what is drawn of them: the surface of active events, binary frames.

Section III-A.1 of the paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.recordings import Events


@dataclass(frozen=True, eq=False)
class ClusterEvents:
    """The events of one camera in one cluster.

    Attributes
    ----------
    parts
        Events at their raw pixels, without those that the noise filter left out, in consecutive
        parts.
    table
        (raw height, raw width, 2) float32 rectified pixel (u, v) of every raw pixel.
    resolution
        (width, height) of the rectified image.
    noise_rate
        Background activity of the sensor, events per pixel and second; 0 before it is known.
    noise_count
        Expected number of events among them that are background activity.
    left_out
        Numbers of events that the noise filter left out since the cluster before: background
        activity, of hot pixels.
    """

    parts: tuple[Events, ...]
    table: NDArray[np.float32]
    resolution: tuple[int, int]
    noise_rate: float = 0.0
    noise_count: float = 0.0
    left_out: tuple[int, int] = (0, 0)

    @property
    def events(self) -> Events:
        """All events, joined."""
        return Events.concatenate(self.parts)

    @property
    def event_count(self) -> int:
        """Number of events, including those that rectify to outside the image."""
        return sum(map(len, self.parts))

    @property
    def contour_count(self) -> float:
        """Estimated number of events of contours that moved."""
        return max(0.0, self.event_count - self.noise_count)

    @cached_property
    def active(self) -> NDArray[np.bool_]:
        """Raw pixels (raw height, raw width) with an event."""
        active = np.zeros(self.table.shape[:2], np.bool_)
        for events in self.parts:
            _mark(active, events.x, events.y)
        return active

    @property
    def coverage(self) -> float:
        """Share of the raw pixels with an event, from 0 to 1."""
        return np.count_nonzero(self.active) / self.active.size

    @cached_property
    def surface_of_active_events(self) -> NDArray[np.float64]:
        """Time (height, width) of the latest event of each rectified pixel, s; -inf where none."""
        surface = np.full(self.resolution[::-1], -np.inf)
        for events in self.parts:
            _paint(surface, events.x, events.y, events.t, self.table)
        return surface

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

    `flash` is the time before `start` that was left out because of a flash, seconds. `between` is
    the number of events before it, both cameras', that were left out between clusters.
    """

    start: float
    stop: float
    left: ClusterEvents
    right: ClusterEvents
    flash: float = 0.0
    between: int = 0

    @property
    def middle(self) -> float:
        """Middle of the interval, seconds."""
        return 0.5 * (self.start + self.stop)

    @property
    def event_count(self) -> int:
        """Number of events of both cameras."""
        return self.left.event_count + self.right.event_count

    @property
    def is_silent(self) -> bool:
        """Whether no event came, not even noise that was left out."""
        return self.event_count + sum(self.left.left_out) + sum(self.right.left_out) == 0

    @property
    def contour_count(self) -> float:
        """Estimated number of events of contours that moved, of both cameras."""
        return self.left.contour_count + self.right.contour_count

    @property
    def noise_share(self) -> float:
        """Expected share of the events that are background activity, from 0 to 1."""
        noise = self.left.noise_count + self.right.noise_count
        return min(1.0, noise / max(1, self.event_count))


@kernel
def _mark(active: NDArray[np.bool_], x: NDArray[np.uint16], y: NDArray[np.uint16]) -> None:
    for i in range(len(x)):
        active[y[i], x[i]] = True


@kernel
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
