"""The ratio of the contrast thresholds of two cameras that see the same contours.

A pixel that sees a contour of the contrast D pass has about D / C events. Where contrasts are
distributed exponentially, numbers of events are so geometrically, and pixels that have any have
m = 1 / (1 - exp(-C / D)) of them on average, D being the mean contrast. Both cameras have the same
contrasts, and whatever else they see of the scene, and however many of their pixels are dead:
log(1 - 1 / m) of each tells the ratio of their thresholds.
"""

from __future__ import annotations

import numpy as np

from gpvo.events import ClusterEvents, StereoCluster
from gpvo.tracking.event_spacing import rows_apart

FEWEST = 300
"""Number of pixels with events that tell the ratio."""
ALIKE = 0.15
"""Largest difference of both shares of noise: the filter leaves out events of contours, too."""
MEMORY = 100
"""Number of clusters over which it is averaged: thresholds stay."""
DOUBT = 0.04
"""Deviation of the ratio's logarithm: what is not above it says nothing against equal thresholds.

A hundredth moves all landmarks at 3 m by some millimetres when the motion turns.
"""
MOST = 2.0
"""Largest ratio: what is beyond has other causes."""


class ThresholdRatio:
    """Learns the right camera's contrast threshold over the left one's.

    It begins again when the noise of the sensors becomes known.
    """

    def __init__(self) -> None:
        self._log, self._count, self._noise_is_known = 0.0, 0, False

    @property
    def value(self) -> float:
        """The ratio, as known now; 1 at the beginning."""
        shown = 1 - np.exp(-0.5 * (self._log / DOUBT) ** 2)
        return float(np.exp(shown * self._log))

    def follow(self, cluster: StereoCluster) -> None:
        """Learn it from a cluster in which contours moved."""
        if not self._noise_is_known and cluster.noise_share > 0:
            self._log, self._count, self._noise_is_known = 0.0, 0, True
        if abs(noise_before_filter(cluster.left) - noise_before_filter(cluster.right)) > ALIKE:
            return
        left, right = threshold_over_contrast(cluster.left), threshold_over_contrast(cluster.right)
        if not (np.isfinite(left) and np.isfinite(right)):
            return
        found = float(np.clip(np.log(right / left), -np.log(MOST), np.log(MOST)))
        self._count = min(self._count + 1, MEMORY)
        self._log += (found - self._log) / self._count


def noise_before_filter(events: ClusterEvents) -> float:
    """Return the share of a camera's events that were noise before the filter left some out."""
    left_out, _ = events.left_out
    return (events.noise_count + left_out) / max(1, events.event_count + left_out)


def threshold_over_contrast(events: ClusterEvents) -> float:
    """Estimate C / D of a cluster's events; not a number if they are too few.

    Of many events those of every so many rows are taken. Noise has a pixel for each event.
    """
    rows = rows_apart(events)
    total = sum(np.count_nonzero(part.y % rows == 0) for part in events.parts)
    noise = events.noise_count * total / max(events.event_count, 1)
    count, pixels = total - noise, np.count_nonzero(events.active[::rows]) - noise
    if not FEWEST <= pixels < count:
        return np.nan
    return -float(np.log1p(-pixels / count))
