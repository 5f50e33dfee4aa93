"""Motion-compensated event images: every event where its contour was at one reference time.

Contours stay thin however long the cluster. Events are moved along the image motion of the latest
tracked features, which is taken to be the same between neighbours and to go on as it was. What that
gets wrong cancels where it matters: a feature is moved back to the mean time of its own events.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpvo.config.stages import CompensationConfig
from gpvo.events import RectifiedEvents, StereoCluster
from gpvo.tracking.observations import Observations

Array = NDArray[np.float64]
Flow = NDArray[np.float32]
"""(height, width, 2) image motion, pixels per second."""

CELL = 8
"""Side of the cells that the image motion is averaged for, pixels; it is interpolated between."""
PULL = 0.05
"""Weight of the median motion, in features at a cell's own place."""
LEAST_FEATURES = 8
"""Features below which nothing is said of the image motion."""


@dataclass(frozen=True, eq=False)
class CompensatedImage:
    """The events of one camera in one cluster, moved to a reference time.

    Attributes
    ----------
    reference
        Seconds.
    flow
        The image motion that they were moved along.
    count
        (height, width) events per pixel, shared among the four pixels around each of them.
    delay
        (height, width) sum of these events' times after the reference time, seconds.
    """

    reference: float
    flow: Flow
    count: Array
    delay: Array

    @staticmethod
    def of_events(events: RectifiedEvents, flow: Flow, reference: float) -> CompensatedImage:
        """Move events along the image motion (pixels per second) to a time (seconds)."""
        count, delay = np.zeros((2, *flow.shape[:2]))
        _splat(events.points, events.t - reference, flow, count, delay)
        return CompensatedImage(reference, flow, count, delay)

    @property
    def picture(self) -> NDArray[np.uint8]:
        """(height, width) image that tends to 255 as events per pixel grow."""
        return np.rint(255 * (1 - np.exp(-self.count.astype(np.float32)))).astype(np.uint8)

    def at_own_times(self, points: Array, radius: float) -> tuple[Array, Array]:
        """Points (N, 2) of the picture where they were at the mean times (N,) of their events.

        The mean is over the events within `radius` pixels. If the image motion is wrong, the
        picture is off by that error times the mean delay of its events, and so is the way back.
        """
        later = _mean_delays(self.count, self.delay, points, radius)
        height, width = self.count.shape
        column, row = np.clip(np.rint(points).astype(int), 0, (width - 1, height - 1)).T
        return points + later[:, None] * self.flow[row, column], self.reference + later


class MotionCompensation:
    """Makes the pictures of clusters, and learns the image motion from what is tracked in them.

    `frames` is the number of latest clusters that observations may be of.
    """

    def __init__(self, config: CompensationConfig, frames: int) -> None:
        self._config = config
        self._images: deque[tuple[CompensatedImage, CompensatedImage]] = deque(maxlen=frames)
        self._frame_count = 0
        self._recent: Observations | None = None

    def pictures(self, cluster: StereoCluster) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Left and right picture of a new cluster, of its middle."""
        middle = 0.5 * (cluster.start + cluster.stop)
        left, right = (
            CompensatedImage.of_events(image.events(), flow, middle)
            for image, flow in zip((cluster.left, cluster.right), self._flows(cluster), strict=True)
        )
        self._images.append((left, right))
        self._frame_count += 1
        return left.picture, right.picture

    def timed(self, seen: Observations) -> Observations:
        """What was seen in pictures, moved to the mean times of its events, with these times.

        Disparities stay those of the pictures, whose two sides have one time.
        """
        self._remember(seen)
        left, times = seen.left.copy(), np.empty((len(seen), 2))
        oldest = self._frame_count - len(self._images)
        for number, (left_image, right_image) in enumerate(self._images, oldest):
            now, radius = seen.frame == number, self._config.time_radius
            left[now], times[now, 0] = left_image.at_own_times(seen.left[now], radius)
            _, times[now, 1] = right_image.at_own_times(seen.right[now], radius)
        return replace(seen, left=left, right=seen.right + left - seen.left, own_times=times)

    def _remember(self, seen: Observations) -> None:
        """Keep what was seen in the two latest clusters."""
        known = seen if self._recent is None else Observations.concatenate([self._recent, seen])
        self._recent = known[known.frame >= self._frame_count - 2]

    def _flows(self, cluster: StereoCluster) -> tuple[Flow, Flow]:
        """Image motion between the two latest clusters, left and right; none if unknown."""
        shape = cluster.left.surface_of_active_events.shape
        nothing: Flow = np.zeros((*shape, 2), np.float32)
        if self._recent is None or len(self._images) < 2:
            return nothing, nothing
        seen, (before, latest) = self._recent, list(self._images)[-2:]
        newest = seen.frame == self._frame_count - 1
        earlier, later = seen[~newest], seen[newest]
        _, i, j = np.intersect1d(earlier.landmark, later.landmark, return_indices=True)
        if len(i) < LEAST_FEATURES:
            return nothing, nothing
        dt, reach = latest[0].reference - before[0].reference, self._config.reach
        left, right = (
            flow_between(old[i], new[j], dt, shape, reach)
            for old, new in ((earlier.left, later.left), (earlier.right, later.right))
        )
        return left, right


def flow_between(
    earlier: Array, later: Array, dt: float, shape: tuple[int, int], reach: float
) -> Flow:
    """Image motion of all pixels from features at points (N, 2) that moved to others within dt.

    A mean of the features' motions, weighted by a Gaussian of the distance whose standard deviation
    is `reach` pixels; the median motion where there are none. `shape` is the image's.
    """
    height, width = shape
    motion = (later - earlier) / dt
    columns, rows = (CELL * (np.arange(-(-side // CELL)) + 0.5) - 0.5 for side in (width, height))
    across = np.exp(-(((columns[:, None] - later[:, 0]) / reach) ** 2) / 2)
    down = np.exp(-(((rows[:, None] - later[:, 1]) / reach) ** 2) / 2)
    total = np.stack([(down * part) @ across.T for part in motion.T], axis=-1)
    mean = (total + PULL * np.median(motion, axis=0)) / (down @ across.T + PULL)[..., None]
    large = cv2.resize(mean.astype(np.float32), (len(columns) * CELL, len(rows) * CELL))
    return np.asarray(large[:height, :width], np.float32)


@njit(cache=True)
def _splat(points: Array, delays: Array, flow: Flow, count: Array, delay: Array) -> None:
    """Add events to the four pixels around their places at the reference time (bilinear)."""
    height, width = count.shape
    for i in range(len(delays)):
        u, v = points[i]
        motion = flow[int(np.rint(v)), int(np.rint(u))]
        u, v = u - delays[i] * motion[0], v - delays[i] * motion[1]
        if not (0 <= u < width - 1 and 0 <= v < height - 1):
            continue
        column, row = int(u), int(v)
        right, low = u - column, v - row
        for y, share in ((row, 1 - low), (row + 1, low)):
            count[y, column] += share * (1 - right)
            count[y, column + 1] += share * right
            delay[y, column] += share * (1 - right) * delays[i]
            delay[y, column + 1] += share * right * delays[i]


@njit(cache=True)
def _mean_delays(count: Array, delay: Array, points: Array, radius: float) -> Array:
    """Mean delay (N,) of the events within a radius of points (N, 2); 0 where there are none."""
    height, width = count.shape
    means = np.zeros(len(points))
    for i in range(len(points)):
        u, v = points[i]
        events = total = 0.0
        for row in range(max(0, int(np.ceil(v - radius))), min(height - 1, int(v + radius)) + 1):
            half = np.sqrt(max(radius**2 - (row - v) ** 2, 0.0))
            first, last = max(0, int(np.ceil(u - half))), min(width - 1, int(u + half))
            for column in range(first, last + 1):
                events += count[row, column]
                total += delay[row, column]
        means[i] = total / events if events > 0 else 0.0
    return means
