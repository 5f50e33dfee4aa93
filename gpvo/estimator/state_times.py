"""When states are: at measurements, at key times, and how long they stay in the window."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.wnoa import halfway_duration
from gpvo.config.stages import EstimatorConfig, NoiseConfig
from gpvo.tracking.image_acceleration import image_density

Array = NDArray[np.float64]
SAME_TIME = 5e-7
"""Seconds; times nearer than this, half the resolution of event stamps, are one state."""
STIFFNESS = 0.8
"""Standard deviation of a state half-way between two key states, given both, in an image: as a
share of that of a measurement. Beyond it the motion between would be linearised too far away."""


def state_times(t: Array, interval: float, after: float = -np.inf) -> Array:
    """Return increasing times of states: those of t (N,) that are `interval` or more apart.

    Only times beyond `after` are taken, by as much, and always the latest; times nearer than
    `SAME_TIME` are one.
    """
    kept: list[float] = []
    increasing = np.unique(t).tolist()
    for time in increasing:
        if time - after > max(interval, SAME_TIME):
            kept.append(time)
            after = time
        elif time == increasing[-1] and time - after > SAME_TIME:
            kept.append(time)
    return np.array(kept)


def key_times(last: float, measured: Array, stop: float, interval: float) -> Array:
    """Return times of states after the last one up to `stop`, an interval or less apart.

    A gap in the measurements (N,) that is longer than the interval has no state between its ends.
    """
    if stop - last <= SAME_TIME:
        return np.empty(0)
    inside = measured[(measured > last + SAME_TIME) & (measured < stop - SAME_TIME)]
    points = np.concatenate([[last], np.sort(inside), [stop]])
    gaps = np.flatnonzero(np.diff(points) > interval)
    starts, ends = points[np.append(0, gaps + 1)], points[np.append(gaps, len(points) - 1)]
    times: list[float] = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        count = int(np.ceil((end - start) / interval - 1e-6))
        times += np.linspace(start, end, max(count, 1) + 1).tolist()
    return state_times(np.array(times), 0.0, last)


def key_interval(noise: NoiseConfig, camera: StereoCamera, disparity: float) -> float:
    """Return the longest time between key states, seconds.

    Half-way between two states dt apart, the prior's variance is Q_c dt^3 / 192. Seen in the image
    of a landmark with this disparity, its root is at most `STIFFNESS` of the measurement's.
    """
    density = image_density(camera, np.array(noise.acceleration_psd), disparity / camera.baseline)
    deviation = STIFFNESS / np.sqrt(max(noise.measurement_information[:2]))
    return halfway_duration(density, float(deviation))


class Lag:
    """The window: the latest clusters, or the latest seconds if the configuration has a lag."""

    def __init__(self, config: EstimatorConfig) -> None:
        self._seconds = config.lag
        self._ends: deque[float] = deque(maxlen=config.window)

    def advance(self, stop: float) -> None:
        """Let a cluster end at `stop`, or none later than the last one."""
        self._ends.append(max([stop, *self._ends]))

    @property
    def stop(self) -> float:
        """End of the latest cluster, seconds; -inf before the first."""
        return self._ends[-1] if self._ends else -np.inf

    @property
    def start(self) -> float:
        """States before it leave the window: seconds, -inf while the window is not full."""
        if self._seconds is not None:
            return self.stop - self._seconds
        return self._ends[0] if len(self._ends) == self._ends.maxlen else -np.inf
