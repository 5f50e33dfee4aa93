"""Landmarks of a stereo frame: matched in its right picture, on their surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.config.stages import KltConfig
from gpvo.tracking.klt.frame import Frame
from gpvo.tracking.klt.lucas_kanade import match_patches
from gpvo.tracking.klt.patch_checks import are_stereo
from gpvo.tracking.klt.surfaces import fit_surfaces, match_on_surfaces
from gpvo.tracking.sights import slopes

Points = NDArray[np.float32]
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_SHARE = 0.1
"""Share of contours' events below which matches are taken to scatter no more."""


class StereoMatches:
    """Matches points of the left picture of frames in the right one.

    Attributes
    ----------
    noise_share
        Share of the events in the pictures that are noise.
    """

    def __init__(self, config: KltConfig, camera: StereoCamera) -> None:
        self._config, self._camera, self.noise_share = config, camera, 0.0

    @property
    def closure_tolerance(self) -> float:
        """Distance up to which matches lead back, pixels.

        They scatter by the inverse of the contours' share in the picture.
        """
        return self._config.closure_tolerance / max(LEAST_SHARE, 1 - self.noise_share)

    def in_right(
        self, frame: Frame, left: Points, guess: Points, coarser: int
    ) -> tuple[Points, Mask]:
        """Return the right points (N, 2) of left ones, and which lead back and are stereo.

        The search begins at the guess (N, 2), at most `coarser` levels above the image.
        """
        right, found = match_patches(*frame.images, left, guess, coarser)
        again = *frame.images[::-1], right, right + (left - guess)
        back, found_back = match_patches(*again, coarser)
        closed = np.linalg.norm(back - left, axis=1) < self.closure_tolerance
        images = frame.left_image.image, frame.right_image.image
        return right, found & found_back & closed & are_stereo(images, left, right, self._config)

    def anchored(
        self, frame: Frame, landmark: NDArray[np.int64], left: Points, right: Points
    ) -> Frame:
        """Return a frame with landmarks seen first in it, at left and right points (N, 2)."""
        if not self._config.slopes:
            return frame.anchored(landmark, left, right)
        right, slope = fit_surfaces(*frame.images, left, right, self._camera.fx)
        return frame.anchored(landmark, left, right, slope)

    def on_surfaces(self, frame: Frame) -> Frame:
        """Match left and right again, on the surfaces of the landmarks' anchors."""
        if not self._config.slopes:
            return frame
        slope = slopes(self._camera, frame.T_start_cam, frame.anchors.sights)
        right = match_on_surfaces(*frame.images, frame.left, frame.right, slope)
        return frame.with_landmarks(frame.landmark, frame.left, right, frame.anchors)


def shift(measurements: Array) -> Points:
    """Return left minus right pixels (N, 2) of measurements (u_left, v, disparity)."""
    return (measurements[:, 2:] * [1.0, 0.0]).astype(np.float32)
