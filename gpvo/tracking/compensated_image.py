"""Motion-compensated event images: events are moved to their positions at one reference time.

Contours stay thin however long the cluster is. The way back, to the mean time of the events around
a feature, makes errors of the image motion cancel for the feature.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpvo.events import ClusterEvents
from gpvo.tracking.event_sums import (
    Flow,
    Sums,
    add_events,
    brightness,
    fine_flow,
    mean_delays,
    motion_at,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CompensatedImage:
    """The events of one camera in one cluster, moved to a reference time.

    Attributes
    ----------
    reference
        Reference time, seconds.
    flow
        Image motion along which the events were moved, cell by cell.
    sums
        (height, width, 2) number of events of each pixel, and sum of their times after the
        reference time, seconds. Each event is shared among the four pixels around it.
    weight
        Number of events that each of the summed ones stands for, per pixel of the sensor.
    thinned
        Number of the cluster's events that were left out because there are enough.
    picture
        (height, width) 255 (1 - exp(-events per pixel of the sensor)), as bright at half the
        resolution as at the full one.
    """

    reference: float
    flow: Flow
    sums: Sums
    picture: NDArray[np.uint8]
    weight: float
    thinned: int = 0

    @staticmethod
    def of_events(
        image: ClusterEvents,
        flow: Flow,
        reference: float,
        side: int = 1,
        density: float | None = None,
    ) -> CompensatedImage:
        """Move events along the image motion to a time (seconds), in pixels `side` as wide.

        Of twice `density` events per pixel, or more, one of several is taken, evenly, as if it were
        all of them. None takes all.
        """
        width, height = image.resolution
        sums = np.full((height // side, width // side, 2), 0, np.float32)
        enough = np.inf if density is None else density * sums[..., 0].size
        every = max(1, int(image.event_count / enough))
        fine, count = fine_flow(flow), 0
        for part in image.parts:
            events, count = part[-count % every :], count + len(part)
            add_events(
                events.x, events.y, events.t, every, image.table, side, reference, fine, sums
            )
        weight, thinned = every / side**2, count - len(range(0, count, every))
        return CompensatedImage(reference, flow, sums, brightness(sums, weight), weight, thinned)

    def held(self, reference: float) -> CompensatedImage:
        """Return the same image at a later time, when nothing has moved."""
        still, counts = np.zeros_like(self.flow), self._sums_at_reference(1.0)
        return CompensatedImage(reference, still, counts, self.picture, self.weight)

    def continued(self, later: CompensatedImage, share: float) -> CompensatedImage:
        """Return a later image with its own events, and a share of these before them."""
        sums = later.sums * np.float32(later.weight / self.weight) + self._sums_at_reference(share)
        picture = brightness(sums, self.weight)
        return replace(later, sums=sums, picture=picture, weight=self.weight)

    def _sums_at_reference(self, share: float) -> Sums:
        """Return a share of the events, all at the reference time."""
        return self.sums * np.array([share, 0], np.float32)

    @property
    def count(self) -> NDArray[np.float32]:
        """Events per pixel (height, width)."""
        return self.sums[..., 0]

    def at_own_times(self, points: Array, radius: float) -> tuple[Array, Array]:
        """Move points (N, 2) of the picture to the mean times (N,) of their events; return both.

        The mean is over the events within `radius` pixels. If the image motion is wrong, the
        picture is off by that error times the mean delay of its events. The way back is off by the
        same amount, so that the errors cancel.
        """
        later = mean_delays(self.sums, points, radius)
        return points + later[:, None] * motion_at(self.flow, points), self.reference + later
