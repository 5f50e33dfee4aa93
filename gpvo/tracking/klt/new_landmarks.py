"""New landmarks: the strongest features of a frame that are found in its right picture."""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_inverse
from gpvo.config import TrackingConfig
from gpvo.tracking.features import ANY, Crowd, extrema, strongest_spaced
from gpvo.tracking.klt.feature_count import FeatureCount
from gpvo.tracking.klt.frame import Frame
from gpvo.tracking.klt.pose_information import most_telling, whitened_jacobians
from gpvo.tracking.klt.row_search import search_rows
from gpvo.tracking.klt.stereo_matches import StereoMatches
from gpvo.tracking.klt.surfaces import LEAST_DISPARITY

Points = NDArray[np.float32]

PARTS = 4
"""Parts along each side of the image, whose numbers of first features are limited."""


class NewLandmarks:
    """Finds new landmarks in frames, where these have room for them.

    Attributes
    ----------
    count
        Number of landmarks so far: the identity of the next one.
    T_before
        (4, 4) pose T_start_cam of the frame before the latest.
    """

    def __init__(
        self,
        config: TrackingConfig,
        camera: StereoCamera,
        allowed: FeatureCount,
        stereo: StereoMatches,
    ) -> None:
        self._config, self._features, self._camera = config.klt, config.features, camera
        self._allowed, self._stereo = allowed, stereo
        self.count, self.T_before = 0, np.eye(4)

    def detect(self, frame: Frame) -> Points:
        """Return the strongest features (N, 2) of the left image that are not near a landmark.

        They are more than there is room for, if there is any. The first ones are spread, as nothing
        is known of the motion.
        """
        more = self._config.candidates if len(frame.landmark) else 1.0
        return self.strongest(frame, int(more * self._allowed.room(frame)))

    def strongest(self, frame: Frame, count: int) -> Points:
        """Return at most `count` features (N, 2) that are not near a landmark."""
        points, _, response = extrema(
            frame.left_image.image, self._features.nms_radius, self._features.response_threshold
        )
        apart = self._config.spacing, count, self._crowd(frame)
        chosen = strongest_spaced(points, response, frame.left, *apart)
        return points[chosen].astype(np.float32)

    def in_stereo(self, left: Points, frame: Frame) -> Frame:
        """Make landmarks of the left features (N, 2) that have a match in the right image."""
        guess, known = search_rows(*frame.images, left)
        left, guess = self._most_telling(left[known], guess[known], frame)
        right, new = self._stereo.in_right(frame, left, guess, self._config.pyramid_levels)
        landmark = self.count + np.arange(new.sum())
        self.count += len(landmark)
        return self._stereo.anchored(frame, landmark, left[new], right[new])

    def _crowd(self, frame: Frame) -> Crowd:
        """Return how many features each part of the image may have: the first ones are spread."""
        if self._config.crowding is None or len(frame.landmark):
            return ANY
        height, width = (-(-side // PARTS) for side in frame.left_image.image.shape)
        most = ceil(self._config.crowding * self._allowed.most / PARTS**2)
        return Crowd(width, height, most)

    def _most_telling(self, left: Points, guess: Points, frame: Frame) -> tuple[Points, Points]:
        """Choose as many left points (N, 2), and right ones, as a frame has room for.

        Those that tell most of the pose beside its landmarks.
        """
        room = self._allowed.room(frame)
        if len(left) <= room:
            return left, guess
        known, T_before_now = frame.sights.measured, se3_inverse(self.T_before) @ frame.T_start_cam
        disparity = np.maximum(left[:, 0] - guess[:, 0], LEAST_DISPARITY)
        measured = np.concatenate([known, np.column_stack([left, disparity])])
        shape = frame.left_image.image.shape
        rows = whitened_jacobians(self._camera, T_before_now, shape, measured)
        chosen = most_telling(rows, len(known), room)
        return left[chosen], guess[chosen]
