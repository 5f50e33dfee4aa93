"""Landmarks of one stereo frame, its smoothed images, and how the landmarks were seen first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.tracking.klt.anchors import Anchors
from gpvo.tracking.klt.lucas_kanade import Pyramid
from gpvo.tracking.sights import Sights

Points = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Frame:
    """Smoothed stereo frame, and the landmarks (N,) seen in it at pixels (N, 2).

    `T_start_cam` (4, 4) is its pose by the motion so far.
    """

    left_image: Pyramid
    right_image: Pyramid
    T_start_cam: NDArray[np.float64]
    landmark: NDArray[np.int64]
    left: Points
    right: Points
    anchors: Anchors

    @classmethod
    def without_landmarks(
        cls, left_image: Pyramid, right_image: Pyramid, T_start_cam: NDArray[np.float64]
    ) -> Frame:
        """Return a frame before any landmark is known in it."""
        points = np.empty((0, 2), np.float32)
        anchors = Anchors.of_image(left_image, Sights.of_frame(points, points, T_start_cam))
        landmark = np.empty(0, np.int64)
        return cls(left_image, right_image, T_start_cam, landmark, points, points, anchors)

    @property
    def images(self) -> tuple[Pyramid, Pyramid]:
        """Left and right image."""
        return self.left_image, self.right_image

    @property
    def sights(self) -> Sights:
        """Where the landmarks are in this frame."""
        return Sights.of_frame(self.left, self.right, self.T_start_cam)

    def with_landmarks(
        self, landmark: NDArray[np.int64], left: Points, right: Points, anchors: Anchors
    ) -> Frame:
        """Return the same images with other landmarks."""
        return Frame(*self.images, self.T_start_cam, landmark, left, right, anchors)

    def anchored(
        self,
        landmark: NDArray[np.int64],
        left: Points,
        right: Points,
        slope: NDArray[np.float64] | None = None,
    ) -> Frame:
        """Return the same images with landmarks that are seen first in them.

        Their surfaces face the camera if no slopes (N, 2) are given.
        """
        sights = Sights.of_frame(left, right, self.T_start_cam, slope)
        anchors = Anchors.of_image(self.left_image, sights)
        return self.with_landmarks(landmark, left, right, anchors)

    def select(self, mask: NDArray[np.bool_]) -> Frame:
        """Return the frame with some of its landmarks."""
        return self.with_landmarks(
            self.landmark[mask], self.left[mask], self.right[mask], self.anchors[mask]
        )

    def joined(self, other: Frame) -> Frame:
        """Return the landmarks of two frames with the same images."""
        return self.with_landmarks(
            np.concatenate([self.landmark, other.landmark]),
            np.concatenate([self.left, other.left]),
            np.concatenate([self.right, other.right]),
            Anchors.concatenate([self.anchors, other.anchors]),
        )
