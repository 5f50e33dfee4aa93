"""Length of clusters: so long that contours move by the same distance, whatever the speed.

In fast motion they are longer: as long as the motion hardly changes meanwhile. In lively motion
they are shorter: as long as the motion prior tells what happens meanwhile.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import inf, sqrt
from statistics import median

from factors.wnoa import halfway_duration
from gpvo.config import ClusteringConfig
from gpvo.recordings import StereoRig

FIRST = 0.2
"""Events per pixel that end a cluster while the image motion is unknown."""
SHORT = 0.1
"""Duration, seconds, up to which slow motion is trusted to stay so, the least while the motion is
unknown, and that of a camera that begins at rest."""
BLIND = 0.25
"""Longest duration, seconds, while the motion is unknown, and of a camera at rest: it may begin."""
LEAST = 0.05
"""Events per pixel that a cluster may always have, and that slow motion is given time for, noise
not counted."""
FAINT = 0.1
"""As `LEAST`, that fast motion is given time for: what fewer show is lost among noise, not blurred.

With 0.03 instead, 60 simulated recordings, with noise of up to 8 Hz and thresholds of up to 0.48,
are 1.04 ± 0.03 times as far off, their steps 1.05 ± 0.02 times.
"""
LIVELY = 0.5
"""Share of the time between clusters that the motion prior allows, which one may take itself."""
APART = 2.0
"""Times the blur that contours may leave a constant motion from a cluster's begin to the next."""
SURGE = 2.0
"""Times the usual number of events that ends a cluster: the motion became faster meanwhile."""
REMEMBERED = 10
"""Number of latest clusters that say what is usual."""


@dataclass(frozen=True)
class ImageMotion:
    """Motion of the features in the latest clusters, in tracked pixels.

    Attributes
    ----------
    speed
        Pixels per second; None while it is unknown, such as where the motion turns.
    acceleration
        Pixels per second^2, infinite if unknown.
    density
        Power spectral density of the acceleration that the estimator expects, pixels^2 / s^3,
        infinite if unknown.
    """

    speed: float | None = None
    acceleration: float = inf
    density: float = inf

    def time_at_speed(self, way: float) -> float:
        """Return the time in which contours move by so many pixels at their speed."""
        return way / max(self.speed or 0.0, 1e-9)

    def time_accelerating(self, way: float) -> float:
        """Return it if they go on accelerating; from rest if the speed is unknown."""
        speed = self.speed or 0.0
        return 2 * way / max(speed + sqrt(speed**2 + 2 * self.acceleration * way), 1e-9)


class ClusterLength:
    """Limits of the next cluster by time and number of events.

    The speed s of the latest features says how long contours take to move by `config.motion`, and
    their acceleration a for how long a motion of constant speed is right: T seconds from the middle
    of a cluster of 2 T seconds they are a T^2 / 2 away from it, which may be `config.blur`, or more
    where there are too few events to see. The longer time counts. Until the motion is known, and
    where it surges, the number of events ends a cluster. Where the motion is livelier than that, as
    the density of its acceleration says, less of both is enough, if there are `config.picture`
    events per pixel: the motion is looked at more often. Slow motion may become fast meanwhile:
    beyond `SHORT` its clusters last until contours would have moved as far at their acceleration,
    too, or until there are enough events to see it. So do those of unknown motion, as noise hides
    the contours of fewer events, but no longer: where only the acceleration is known, as at a turn,
    contours soon move.
    """

    def __init__(self, config: ClusteringConfig, rig: StereoRig) -> None:
        width, height = rig.left.resolution
        self._config, self._pixels = config, width * height
        self._counts: deque[int] = deque(maxlen=REMEMBERED)
        self._rate, self._noise_rate = inf, 0.0

    def limits(self, motion: ImageMotion, at_rest: bool = False) -> tuple[float, int]:
        """Return the longest duration, seconds, and the most events of either camera.

        A camera at rest has no contours to wait for: where its motion begins is to be seen.
        """
        config = self._config
        if config.max_events is not None:
            return config.window, config.max_events
        if motion.speed is None:
            enough = 0.0 if at_rest else self._time_of(LEAST)
            return self._of_unknown_speed(motion, enough)
        usual = SURGE * float(median(self._counts)) if self._counts else 0.0
        longest = BLIND if at_rest else config.window
        return min(self._duration(motion), longest), max(round(max(usual, LEAST * self._pixels)), 1)

    def _of_unknown_speed(self, motion: ImageMotion, enough: float) -> tuple[float, int]:
        """Return the limits where the latest rate gives enough events in so many seconds.

        If that is long, the motion begins: they may come sooner, and that ends the cluster. So does
        the time in which contours move by their acceleration if it is known.
        """
        config, soon = self._config, inf
        if motion.acceleration < inf:
            soon = max(config.steady, motion.time_accelerating(config.motion))
        most = FIRST * self._pixels
        if enough > SHORT:
            most = LEAST * self._pixels + self._noise_rate * enough
        return min(max(SHORT, enough), soon, BLIND, config.window), max(round(most), 1)

    def _duration(self, motion: ImageMotion) -> float:
        config = self._config
        longest = self._until_moved(motion, config.motion, config.steady)
        least = self._until_moved(motion, config.lively_motion, config.lively_steady)
        known = LIVELY * halfway_duration(motion.density, config.uncertainty)
        return min(longest, max(least, known, self._time_of(config.picture)))

    def _until_moved(self, motion: ImageMotion, way: float, steady: float) -> float:
        """Return the duration in which contours move by so many pixels.

        The motion of longer ones is to be constant, up to `steady` seconds.
        """
        config = self._config
        slow = max(SHORT, motion.time_accelerating(way), self._time_of(LEAST))
        constant = max(self._constant(motion), self._time_of(FAINT))
        sharp = max(config.shortest, min(steady, constant))
        return min(config.window, max(min(motion.time_at_speed(way), slow), sharp))

    def _time_of(self, events: float) -> float:
        """Return the time in which the latest rate gives so many events per pixel."""
        return events * self._pixels / max(self._rate, 1.0)

    def _constant(self, motion: ImageMotion) -> float:
        """Return for how long a motion of constant speed is right."""
        return 2 * sqrt(2 * self._config.blur / max(motion.acceleration, 1e-9))

    def period(self, duration: float, motion: ImageMotion) -> float:
        """Return the time from the begin of a cluster of `duration` seconds to the next one's.

        It is up to `config.spacing` times as long: as far as contours are easily found again, and
        both the estimator's motion prior and the latest change of the motion tell what happens
        between two clusters.
        """
        config = self._config
        near = motion.time_at_speed(config.stride)
        known = halfway_duration(motion.density, config.uncertainty)
        constant = sqrt(APART) * self._constant(motion)
        return max(duration, min(config.spacing * duration, near, known, constant))

    def add(self, events: int, contours: float, duration: float) -> None:
        """Remember the events of a cluster of so many seconds, and those of them of contours.

        They are those of the camera with more. Clusters of a camera at rest do not say what is
        usual in motion.
        """
        self._rate, self._noise_rate = contours / duration, (events - contours) / duration
        if events >= LEAST * self._pixels:
            self._counts.append(events)
