"""Motion-compensated event images: events are moved to their positions at one reference time.

Contours stay thin however long the cluster is. Events are moved along the image motion of the
latest tracked features. This motion is assumed to be the same between neighbouring features and
constant in time. Errors of this assumption cancel for features, because each feature is moved back
to the mean time of its own events.
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
from gpvo.tracking.resolutions import from_full_resolution

Array = NDArray[np.float64]
Flow = NDArray[np.float32]
"""(height, width, 2) image motion, pixels per second."""

CELL = 8
"""Side of the cells of averaged image motion, pixels; motion is interpolated between cells."""
PULL = 0.05
"""Weight of the median motion, where a feature at the centre of a cell has the weight 1."""
STILL = 0.05
"""Share of a full cluster's events below which nothing moved: a tenth of a pixel."""
USUAL = 20
"""Number of latest clusters with motion; the fullest of them is full."""
LEAST_FEATURES = 8
"""Number of features below which the image motion is unknown."""


@dataclass(frozen=True, eq=False)
class CompensatedImage:
    """The events of one camera in one cluster, moved to a reference time.

    Attributes
    ----------
    reference
        Reference time, seconds.
    flow
        Image motion along which the events were moved.
    count
        (height, width) events per pixel; each is shared among the four pixels around it.
    delay
        (height, width) sum of the times of these events after the reference time, seconds.
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

    def held(self, reference: float) -> CompensatedImage:
        """Return the same image at a later time, when nothing has moved."""
        return CompensatedImage(
            reference, np.zeros_like(self.flow), self.count, np.zeros_like(self.delay)
        )

    @property
    def picture(self) -> NDArray[np.uint8]:
        """Image (height, width) 255 (1 - exp(-count))."""
        return np.rint(255 * (1 - np.exp(-self.count.astype(np.float32)))).astype(np.uint8)

    def at_own_times(self, points: Array, radius: float) -> tuple[Array, Array]:
        """Move points (N, 2) of the picture to the mean times (N,) of their events; return both.

        The mean is over the events within `radius` pixels. If the image motion is wrong, the
        picture is off by that error times the mean delay of its events. The way back is off by the
        same amount, so that the errors cancel.
        """
        later = _mean_delays(self.count, self.delay, points, radius)
        height, width = self.count.shape
        column, row = np.clip(np.rint(points).astype(int), 0, (width - 1, height - 1)).T
        return points + later[:, None] * self.flow[row, column], self.reference + later


class MotionCompensation:
    """Pictures of clusters, compensated by the image motion of the features tracked in them.

    Where (almost) no event came nothing moved: such a cluster has the pictures before it, at its
    own time, so that features are seen at rest.

    `frames` is the number of latest clusters to which observations may belong. Pixels of the
    pictures are `side` pixels of the events wide; all positions are pixels of the pictures.
    `at_rest` says whether nothing moved in the latest cluster.
    """

    def __init__(self, config: CompensationConfig, frames: int, side: int = 1) -> None:
        self._config, self._side = config, side
        self._images: deque[tuple[CompensatedImage, CompensatedImage]] = deque(maxlen=frames)
        self._frame_count = 0
        self.at_rest = False
        self._recent: Observations | None = None
        self._full_count: deque[float] = deque(maxlen=USUAL)

    def pictures(self, cluster: StereoCluster) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Make the left and right picture of a new cluster at the middle of its interval."""
        middle = 0.5 * (cluster.start + cluster.stop)
        self.at_rest = len(self._images) > 0 and self._is_still(cluster)
        if self.at_rest:
            left, right = (image.held(middle) for image in self._images[-1])
        else:
            left, right = (
                CompensatedImage.of_events(self._scaled(image.events()), flow, middle)
                for image, flow in zip(
                    (cluster.left, cluster.right), self._flows(cluster), strict=True
                )
            )
        self._images.append((left, right))
        self._frame_count += 1
        return left.picture, right.picture

    def _scaled(self, events: RectifiedEvents) -> RectifiedEvents:
        if self._side == 1:
            return events
        return replace(events, points=from_full_resolution(events.points, self._side))

    def _is_still(self, cluster: StereoCluster) -> bool:
        """Compare the events of both cameras with those of recent clusters."""
        count = cluster.left.contour_count + cluster.right.contour_count
        still = len(self._full_count) > 0 and count < STILL * np.max(self._full_count)
        if not still:
            self._full_count.append(count)
        return bool(still)

    def timed(self, seen: Observations) -> Observations:
        """Move observations from the pictures to the mean times of their events; add the times.

        Disparities stay those of the pictures, because both pictures have the same reference time.
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
        """Keep the observations of the two latest clusters."""
        known = seen if self._recent is None else Observations.concatenate([self._recent, seen])
        self._recent = known[known.frame >= self._frame_count - 2]

    def _flows(self, cluster: StereoCluster) -> tuple[Flow, Flow]:
        """Estimate left and right image motion between the two latest clusters; 0 if unknown."""
        height, width = cluster.left.surface_of_active_events.shape
        shape = height // self._side, width // self._side
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
    """Estimate the image motion of all pixels from features that moved within dt seconds.

    `earlier` and `later` are the pixels (N, 2) of the same features, and `shape` is that of the
    image. The motion is the mean of the features' motions, weighted by a Gaussian of the distance
    with the standard deviation `reach` pixels. Far from all features it is their median motion.
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
    """Add events to the four pixels around their positions at the reference time (bilinear)."""
    height, width = count.shape
    for i in range(len(delays)):
        u, v = points[i]
        motion = flow[min(int(np.rint(v)), height - 1), min(int(np.rint(u)), width - 1)]
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
    """Compute the mean delay (N,) of the events within a radius of points (N, 2); 0 if none."""
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
