"""Flashes, in which all pixels fire at once, because the light changed and not the view."""

from __future__ import annotations

from collections import deque

import numpy as np

from gpvo.events.cluster_length import SHORT

SUDDEN = 0.2
"""A flash fills a cluster in less than this share of the usual time, of SHORT at most.

At rest clusters last longer, and whatever moves then is sudden.
"""
WIDE = 2.0
"""A flash covers more than this many times the usual share of the pixels."""
LONGEST = 0.3
"""What lasts longer is the new normal, seconds."""
REMEMBERED = 10
"""Number of latest clusters that say what is usual."""
QUIET = 0.1
"""Share of the usual coverage below which a cluster says nothing: the camera is at rest."""


class FlashDetector:
    """Tells flashes from fast motion by how suddenly and how widely events come.

    A contour makes several events at a pixel, a flash makes them at all pixels.
    """

    def __init__(self) -> None:
        self._durations: deque[float] = deque(maxlen=REMEMBERED)
        self._coverages: deque[float] = deque(maxlen=REMEMBERED)
        self._skipped = 0.0

    def is_flash(self, duration: float, coverage: float) -> bool:
        """Judge a cluster by its duration, seconds, and its share of pixels with an event."""
        if self._is_unusual(duration, coverage):
            self._skipped += duration
            if self._skipped <= LONGEST:
                return True
            self._durations.clear()
            self._coverages.clear()
        self._skipped = 0.0
        if coverage >= QUIET * float(np.median(self._coverages or [0.0])):
            self._durations.append(duration)
            self._coverages.append(coverage)
        return False

    def _is_unusual(self, duration: float, coverage: float) -> bool:
        if len(self._durations) < REMEMBERED:
            return False
        sudden = duration < SUDDEN * min(SHORT, np.median(self._durations))
        return bool(sudden and coverage > WIDE * np.median(self._coverages))
