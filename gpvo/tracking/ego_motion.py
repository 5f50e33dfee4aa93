"""Motion of the camera between two frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_exp

Array = NDArray[np.float64]

ALONE = 6
"""Number of frames after which a pose that was found anew is known to the estimator, too."""


class EgoMotion:
    """Poses of the frames, by the latest velocity of MC-RANSAC from the latest pose that is known.

    They warp patches of frames that are apart in time, and say where a landmark will be in the next
    frame; no measurement is made of them.

    Attributes
    ----------
    velocity
        (6,) body twist of the latest cluster, rad/s and m/s.
    T_start_cam
        (4, 4) pose of the latest frame.
    """

    def __init__(self) -> None:
        self.velocity, self.T_start_cam = np.zeros(6), np.eye(4)
        self._t: float | None = None
        self._alone = 0

    def restart(self, t: float, T_start_cam: Array) -> None:
        """Go on from a pose at time t, seconds, that is known better."""
        if self._alone == 0:
            self.T_start_cam, self._t = T_start_cam, t

    def relocate(self, T_start_cam: Array) -> None:
        """Go on from a pose of the latest frame that was found anew."""
        self.T_start_cam, self._alone = T_start_cam, ALONE

    def advance(self, t: float) -> None:
        """Move on to a frame at time t, seconds."""
        dt = 0.0 if self._t is None else t - self._t
        self.T_start_cam = self.T_start_cam @ se3_exp(dt * self.velocity)
        self._t, self._alone = t, max(self._alone - 1, 0)


def camera_of_pixels(camera: StereoCamera, side: int) -> StereoCamera:
    """Return the camera in pixels `side` of the sensor's pixels wide."""
    shift = (side - 1) / 2
    return replace(
        camera,
        fx=camera.fx / side,
        fy=camera.fy / side,
        cx=(camera.cx - shift) / side,
        cy=(camera.cy - shift) / side,
    )
