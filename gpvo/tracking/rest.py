"""Whether a camera is at rest: both sides send noise, and (almost) no event of contours.

How many events are of contours is told by how uneven they are. Noise is even over the sensor: it
adds to the number of events, but not to the spread of the numbers in blocks of pixels. So a rest is
told from motion however long a cluster is, whether or not its noise is known and left out.
"""

from __future__ import annotations

from collections import deque
from math import sqrt

from gpvo.events import StereoCluster
from gpvo.events.unevenness import Unevenness
from gpvo.tracking.contour_way import USUAL

STILL = 0.05
"""Share of a full cluster's events below which nothing moved: a tenth of a pixel."""
NOISY = 0.1
"""Share of a full cluster's spread below which events are noise: a fifth of a pixel."""
RARE = 0.5
"""Share of the rate of events in motion that rest has less than: flashes have more, as even.

More noise is left out by the filter.
"""
UNIFORM = 0.2
"""Squared coefficient of variation up to which what is left of many events is noise alone."""
EVEN = 0.13
"""The same as long as nothing is known to compare with: contours among much noise have 0.16."""


class Rest:
    """Tells of each cluster whether the camera is at rest.

    Attributes
    ----------
    at_rest
        Nothing moved in the latest cluster: what came is the noise of both cameras.
    is_still
        The same, or almost nothing came at all: without noise the cameras may as well have failed.
    """

    def __init__(self) -> None:
        self.at_rest = self.is_still = False
        self._unevenness = Unevenness()
        self._moved = deque[tuple[float, float, float]](maxlen=USUAL)

    def see(self, cluster: StereoCluster) -> None:
        """Compare the events of both cameras with those of recent clusters that moved, if any."""
        count, variation = cluster.contour_count, self._unevenness.squared_variation(cluster)
        spread = cluster.event_count * sqrt(max(0.0, variation or 0.0))
        rate = cluster.event_count / max(cluster.stop - cluster.start, 1e-9)
        if not self._moved:
            self.at_rest = variation is not None and variation < EVEN
            self.is_still = self.at_rest or variation is None
        else:
            full, uneven, fast = map(max, zip(*self._moved, strict=True))
            is_even = variation is not None and variation < UNIFORM
            self.at_rest = is_even and spread < NOISY * uneven and rate < RARE * fast
            self.is_still = self.at_rest or count < STILL * full
        if not self.is_still:
            self._moved.append((count, spread, rate))
            self._unevenness.clear()
