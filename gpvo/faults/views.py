"""What both cameras see: swapped, or one higher than the other.

Left and right pictures of events are correlated as a whole. In a rectified pair the right one is
shifted to the left, by the disparities, and not at all up or down.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from gpvo.events import ClusterEvents, StereoCluster
from gpvo.faults.fault import Fault

Array = NDArray[np.float64]

LOOKS = 4
"""Number of clusters that are looked at."""
WITHIN = 1.0
"""Seconds in which they come."""
LEAST_EVENTS = 0.02
"""Events per pixel of a cluster with a view."""
ROWS = 16
"""Largest shift up or down that is searched, tracked pixels."""
LARGE = 346
"""Width beyond which pictures are looked at in halves of it."""
CLEAR = 1.3
"""Factor by which the correlation of the wrong view beats that of the right one."""
SHIFT = 2
"""Least shift up or down that is said, tracked pixels."""


class Views:
    """Correlates the cameras' views in the first second."""

    def __init__(self) -> None:
        self._start: float | None = None
        self._looks = 0
        self._sum: Array | None = None
        self._side = 1

    def see(self, cluster: StereoCluster) -> Iterator[Fault]:
        """Look at the next cluster; yield what is wrong after the last look."""
        if self._looks >= LOOKS or not _has_view(cluster):
            return
        if self._start is None:
            self._start = cluster.start
        if cluster.start < self._start + self._looks * WITHIN / LOOKS:
            return
        self._side = max(1, round(cluster.left.resolution[0] / LARGE))
        found = correlation(*(picture(one, self._side) for one in (cluster.left, cluster.right)))
        self._sum = found if self._sum is None else self._sum + found
        self._looks += 1
        if self._looks == LOOKS:
            yield from self._judge(self._sum)

    def _judge(self, seen: Array) -> Iterator[Fault]:
        """Judge the correlations (rows, columns) of shifts, none of them in the middle."""
        middle = seen.shape[1] // 2
        level = seen[ROWS - 1 : ROWS + 2]
        right, wrong = level[:, : middle + 1].max(), level[:, middle + 3 :].max()
        rows, shift = seen.max(axis=1), int(seen.max(axis=1).argmax()) - ROWS
        if wrong > CLEAR * right and wrong >= rows.max():
            yield _swapped(self._start or 0.0)
        elif abs(shift) >= SHIFT and rows.max() > CLEAR * rows[ROWS]:
            yield _shifted(self._start or 0.0, shift * self._side)


def picture(events: ClusterEvents, side: int) -> Array:
    """Make the picture of pixels with events, without its coarse shades."""
    image = (events.binary_frame > 0).astype(np.float32)
    if side > 1:
        image = cv2.resize(image, None, fx=1 / side, fy=1 / side, interpolation=cv2.INTER_AREA)
    fine = cv2.GaussianBlur(image, (0, 0), 1.0) - cv2.GaussianBlur(image, (0, 0), 8.0)
    return np.asarray(fine, np.float64)


def correlation(left: Array, right: Array) -> Array:
    """Correlate pictures for shifts of the right one, (2 ROWS + 1, 2 reach + 1), of 1 if alike.

    Shifts down and to the right are positive.
    """
    height, width = left.shape
    reach = width // 3
    # What is shifted out of a picture must not come back in; some larger sizes are much faster.
    size = cv2.getOptimalDFTSize(height + ROWS), cv2.getOptimalDFTSize(width + reach)
    spectrum = np.conj(np.fft.rfft2(left, size)) * np.fft.rfft2(right, size)
    shifts = np.fft.irfft2(spectrum, size) / (np.linalg.norm(left) * np.linalg.norm(right))
    rows, columns = np.arange(-ROWS, ROWS + 1), np.arange(-reach, reach + 1)
    return np.asarray(shifts[np.ix_(rows, columns)])


def _has_view(cluster: StereoCluster) -> bool:
    width, height = cluster.left.resolution
    least = min(cluster.left.event_count, cluster.right.event_count)
    return least >= LEAST_EVENTS * width * height


def _swapped(t: float) -> Fault:
    return Fault(
        "cameras swapped",
        t,
        "the cameras seem to be swapped: the right picture lies to the right of the left one;"
        " exchange --left-topic and --right-topic, or the calibration's cameras",
    )


def _shifted(t: float, rows: int) -> Fault:
    where = "lower" if rows > 0 else "higher"
    return Fault(
        "rows differ",
        t,
        f"the right picture lies {abs(rows)} rows {where} than the left one: the calibration is"
        " not that of these cameras, or one of them was moved; calibrate again",
        numbers={"rows": rows},
    )
