"""How many features a frame has: as many as there is time for."""

from __future__ import annotations

import numpy as np

from gpvo.config.stages import KltConfig
from gpvo.tracking.klt.frame import Frame


class FeatureCount:
    """Limits the landmarks of frames.

    Attributes
    ----------
    interval
        Time from the latest frame's begin to the next one's, seconds: there is more time for
        features where it is long.
    """

    def __init__(self, config: KltConfig) -> None:
        self._config, self.interval = config, 0.0
        self._share, self._spacing = 1.0, 1.0

    def limit(self, share: float, spacing: float) -> None:
        """Allow a share of the configured features, from 0 to 1.

        The time is that of frames which are `spacing` times farther apart than they would be.
        """
        self._share, self._spacing = share, spacing

    @property
    def most(self) -> int:
        """Number of landmarks that a frame may have."""
        return int(self._share * self._config.features(self.interval / self._spacing))

    def room(self, frame: Frame) -> int:
        """Return how many more landmarks a frame may have."""
        return max(self.most - len(frame.landmark), 0)

    def first_known(self, frame: Frame) -> Frame:
        """Return a frame with as many of its landmarks as it may have, those known longest."""
        if len(frame.landmark) <= self.most:
            return frame
        return frame.select(np.arange(len(frame.landmark)) < self.most)
