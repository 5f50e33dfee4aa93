"""Tracking of features around the quad by Lucas-Kanade on smoothed event images.

The circle of section III-A.2 is previous left, current left, current right, previous right and
back. It is closed by the patch around a feature instead of its descriptor. A feature then need not
be detected again in all four images, which few features of a binary frame are.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpvo.config import TrackingConfig
from gpvo.second_thread import both
from gpvo.tracking.features import extrema, smooth, strongest_spaced
from gpvo.tracking.klt.lucas_kanade import Pyramid, match_patches
from gpvo.tracking.klt.patch_checks import patch_correlation, row_gradient
from gpvo.tracking.observations import Observations
from gpvo.tracking.report import TrackingReport

Image = NDArray[np.uint8]
Points = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Frame:
    """Smoothed stereo frame, and the landmarks (N,) seen in it at pixels (N, 2)."""

    left_image: Pyramid
    right_image: Pyramid
    landmark: NDArray[np.int64]
    left: Points
    right: Points

    def select(self, mask: Mask) -> _Frame:
        return _Frame(
            self.left_image,
            self.right_image,
            self.landmark[mask],
            self.left[mask],
            self.right[mask],
        )

    def joined(self, other: _Frame) -> _Frame:
        """Return the landmarks of two frames with the same images."""
        return _Frame(
            self.left_image,
            self.right_image,
            np.concatenate([self.landmark, other.landmark]),
            np.concatenate([self.left, other.left]),
            np.concatenate([self.right, other.right]),
        )


class KltTracker:
    """Tracker of the features of one resolution; see `gpvo.tracking.Tracker`.

    `share` of the configured features is looked for, from 0 to 1.
    """

    def __init__(self, config: TrackingConfig) -> None:
        self._config = config.klt
        self._features = config.features
        self._frames: deque[_Frame] = deque(maxlen=config.earlier_frames)
        self._frame_count = 0
        self._landmark_count = 0
        self.report = TrackingReport(0, 0, 0, 0)
        self.share = 1.0

    def track(self, left: Image, right: Image) -> Observations:
        """Follow the known landmarks into a new stereo frame and find new ones there."""
        images = both(lambda: self._pyramid(left), lambda: self._pyramid(right))
        known = len(self._frames[-1].landmark) if self._frames else 0
        followed = self._anchor(self._follow(*images))
        features = self._detect(followed)
        new = self._in_stereo(features, followed)
        self.report = TrackingReport(len(features), len(new.left), known, len(followed.left))
        frame = followed.joined(new)
        self._frames.append(frame)
        self._frame_count += 1
        return Observations(
            frame.landmark,
            np.full(len(frame.landmark), self._frame_count - 1),
            frame.left.astype(np.float64),
            frame.right.astype(np.float64),
        )

    def _pyramid(self, image: Image) -> Pyramid:
        smoothed = smooth(image, self._config.smoothing)
        return Pyramid.of_image(smoothed, self._config.patch_size, self._config.pyramid_levels)

    def _follow(self, left_image: Pyramid, right_image: Pyramid) -> _Frame:
        """Match the landmarks of the previous frame around the quad; keep those that return."""
        if not self._frames:
            nothing = np.empty((0, 2), np.float32)
            return _Frame(left_image, right_image, np.empty(0, np.int64), nothing, nothing)
        previous = self._frames[-1]
        shift = previous.left - previous.right
        left, found = self._match(previous.left_image, left_image, previous.left)
        right, found_right = self._match(left_image, right_image, left, left - shift)
        back, found_back = self._match(right_image, previous.right_image, right)
        end, found_end = self._match(previous.right_image, previous.left_image, back, back + shift)
        closed = np.linalg.norm(end - previous.left, axis=1) < self._config.closure_tolerance
        frame = _Frame(left_image, right_image, previous.landmark, left, right)
        return frame.select(
            found & found_right & found_back & found_end & closed & self._is_stereo(frame)
        )

    def _anchor(self, frame: _Frame) -> _Frame:
        """Match every landmark with the earliest frame that shows it, so that errors do not add up.

        This extends tracklets over earlier frames: each match is compared with one that skips the
        frames in between, and takes the position of that match. The disparity stays: it hardly
        differs a fraction of a pixel beside.
        """
        left, keep = frame.left.copy(), np.ones(len(frame.left), bool)
        anchored = np.zeros(len(left), bool)
        for earlier in list(self._frames)[:-1]:
            _, here, there = np.intersect1d(
                frame.landmark, earlier.landmark, assume_unique=True, return_indices=True
            )
            new = ~anchored[here]
            here, there = here[new], there[new]
            position, found = self._match(
                earlier.left_image, frame.left_image, earlier.left[there], left[here]
            )
            moved = np.linalg.norm(position - left[here], axis=1)
            keep[here] = found & (moved < self._config.anchor_tolerance)
            left[here], anchored[here] = position, True
        right = frame.right + left - frame.left
        moved = _Frame(frame.left_image, frame.right_image, frame.landmark, left, right)
        return moved.select(keep & self._is_stereo(moved))

    def _detect(self, frame: _Frame) -> Points:
        """Return the strongest features (N, 2) of the left image that are not near a landmark."""
        points, _, strength = extrema(
            frame.left_image.image, self._features.nms_radius, self._features.response_threshold
        )
        wanted = int(self.share * self._config.max_features) - len(frame.landmark)
        chosen = strongest_spaced(points, strength, frame.left, self._config.spacing, wanted)
        return points[chosen].astype(np.float32)

    def _in_stereo(self, left: Points, frame: _Frame) -> _Frame:
        """Make landmarks of the left features (N, 2) that have a match in the right image."""
        right, found = self._match(frame.left_image, frame.right_image, left)
        back, found_back = self._match(frame.right_image, frame.left_image, right)
        closed = np.linalg.norm(back - left, axis=1) < self._config.closure_tolerance
        nothing = np.zeros(len(left), np.int64)
        new = _Frame(frame.left_image, frame.right_image, nothing, left, right)
        new = new.select(found & found_back & closed & self._is_stereo(new))
        landmark = self._landmark_count + np.arange(len(new.left))
        self._landmark_count += len(landmark)
        return replace(new, landmark=landmark)

    def _is_stereo(self, frame: _Frame) -> Mask:
        """Check that rows agree, disparities are positive, and points are inside and look alike."""
        height, width = frame.left_image.image.shape
        size = np.array([width, height])
        inside = ((frame.left >= 0) & (frame.left < size)).all(axis=1)
        inside &= ((frame.right >= 0) & (frame.right < size)).all(axis=1)
        row_difference = np.abs(frame.left[:, 1] - frame.right[:, 1])
        positive = frame.left[:, 0] > frame.right[:, 0]
        close = row_difference < self._config.row_tolerance
        return inside & positive & close & self._is_similar(frame)

    def _is_similar(self, frame: _Frame) -> Mask:
        """Check that the middle of a patch is similar in both images and distinct along the row.

        Contours at the margins of the whole patch can determine its match. They may be at another
        depth, while the middle is only noise.
        """
        radius = self._config.patch_size // 4
        left, right = frame.left_image.image, frame.right_image.image
        correlation = patch_correlation(left, frame.left, right, frame.right, radius)
        gradient = row_gradient(left, frame.left, radius)
        distinct = gradient >= self._config.min_row_gradient
        return distinct & (correlation >= self._config.min_correlation)

    def _match(
        self, source: Pyramid, target: Pyramid, points: Points, guess: Points | None = None
    ) -> tuple[Points, Mask]:
        """Match the patches around points (N, 2) of the source with the target image.

        Returns their points in the target (N, 2) and whether they were found (N,). A guess is
        within a pixel or two, and needs no coarse pyramid levels.
        """
        if guess is None:
            return match_patches(source, target, points, points, self._config.pyramid_levels)
        return match_patches(source, target, points, guess, 1)
