"""Acceleration of the image, by the change of the camera's velocity."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera

Array = NDArray[np.float64]
APART = 0.04
"""Least time between velocities that are compared, seconds: nearer ones differ by their noise."""
FORGOTTEN = 0.15
"""Time without a velocity after which the acceleration is unknown again, seconds."""


class ImageAcceleration:
    """How fast the image motion changes in the latest clusters.

    A camera with the angular velocity w and the velocity v moves the image by f |w| + f |v| / Z
    pixels per second at most in its middle, where f / Z is the disparity over the baseline: the
    nearness, pixels per metre.

    Attributes
    ----------
    value
        Pixels per second^2; infinite while it is unknown.
    """

    def __init__(self, camera: StereoCamera) -> None:
        self._camera, self.value = camera, np.inf
        self._nearness = np.inf
        self._known: deque[tuple[float, Array]] = deque()

    def follow(self, t: float, velocity: Array, disparity: Array) -> None:
        """Learn it from the body twist (6,) at time t, seconds, and disparities (N,), pixels."""
        while len(self._known) > 1 and self._known[1][0] <= t - APART:
            self._known.popleft()
        if self._known and len(disparity) > 0:
            start, before = self._known[0]
            change = (velocity - before) / (t - start)
            turn, shift = np.linalg.norm(change[:3]), np.linalg.norm(change[3:])
            self._nearness = float(np.median(disparity)) / self._camera.baseline
            self.value = float(self._camera.fx * turn + self._nearness * shift)
        self._known.append((t, velocity))

    def wait(self, t: float) -> None:
        """Let time pass until t, seconds, in which no velocity was found."""
        if self._known and t - self._known[-1][0] > FORGOTTEN:
            self.value = np.inf

    def density(self, qc: Array) -> float:
        """Return its power spectral density if that of the body is qc (6,), pixels^2 / s^3.

        It is infinite while it is unknown.
        """
        return image_density(self._camera, qc, self._nearness)


def image_density(camera: StereoCamera, qc: Array, nearness: float) -> float:
    """Return the power spectral density of the image's acceleration, pixels^2 / s^3.

    That of the body is qc (6,), along its worst axes. The nearness is f / Z, pixels per metre.
    """
    return float(camera.fx**2 * qc[:3].max() + nearness**2 * qc[3:].max())
