"""How far contours are seen behind where they are.

A pixel has an event when its brightness has changed by the threshold C since its last one. Where a
brightness that rose begins to fall, it must first fall by what it rose since that event, and by C.
So the events of each slope come late, by C / 2 in brightness on average, and a contour is seen
C / (2 |gradient|) behind where it is, against the direction of its motion, however fast it is. Like
the play of a gear this changes only after the motion has turned, and with the way since.

The gradient is not known, but C / |gradient| is the way of the contour between two events of a
pixel: see `gpvo.tracking.event_spacing`. The cameras of a pair see the same gradients with other
thresholds (`gpvo.tracking.threshold_ratio`): where these differ by a third, disparities would be
off by 0.1 pixels, one way or the other as the motion goes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.events import StereoCluster
from gpvo.tracking.event_spacing import EventSpacing
from gpvo.tracking.event_sums import Flow, motion_at
from gpvo.tracking.threshold_ratio import ThresholdRatio

Array = NDArray[np.float64]

WAY = 0.5
"""Way in a new direction after which most of the lag has turned, pixels."""


class StereoLag:
    """Lags of contours in the left and the right image, `share` as in `ContourLag`.

    Pixels are `side` of the sensor's pixels wide.
    """

    def __init__(self, share: float, side: int) -> None:
        self.left, self.right = ContourLag(share), ContourLag(share)
        self._spacing, self._thresholds = EventSpacing(side), ThresholdRatio()

    def follow(
        self, cluster: StereoCluster, flows: tuple[Flow, Flow], dt: float, duration: float
    ) -> Flow:
        """Turn the lags by the left and right image motion of a cluster in which contours moved.

        dt and the duration are those of `ContourLag.follow`, as is what it returns, of the left.
        """
        self._spacing.follow(cluster.left, flows[0], duration)
        self._thresholds.follow(cluster)
        spacing = self._spacing.value
        self.right.follow(flows[1], dt, duration, spacing * self._thresholds.value)
        return self.left.follow(flows[0], dt, duration, spacing)


class ContourLag:
    """Lag of contours at each place of an image, which follows the image motion.

    `share` is its size over the way between two events of a pixel: half by theory.
    """

    def __init__(self, share: float) -> None:
        self._share = share
        self._behind: Flow = np.zeros((1, 1, 2), np.float32)

    def follow(self, flow: Flow, dt: float, duration: float, spacing: float) -> Flow:
        """Turn the lag by the image motion (rows, columns, 2), pixels per second, of a cluster.

        dt is the time since the one before, of which the pictures show `duration`, seconds. The
        spacing is the way between two events where they show a way of one pixel, pixels. Returns by
        how much the lag turned at each place, pixels.
        """
        speed = np.maximum(np.linalg.norm(flow, axis=2, keepdims=True), 1e-9)
        lag = self._share * spacing * np.sqrt(speed * duration) / speed * flow
        change = (1 - np.exp(-speed * dt / WAY)) * (lag - self._behind)
        self._behind = np.asarray(self._behind + change, np.float32)
        return change

    def ahead(self, points: Array) -> Array:
        """Return the way (N, 2) from contours that are seen at points (N, 2) to where they are."""
        return motion_at(self._behind, points)
