"""LIBVISO2's features followed by circular descriptor matching, the paper's front end.

Section III-A.2: new quad matches with the previous frame start or continue tracklets, matches with
a number of earlier frames extend them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.config import TrackingConfig
from gpvo.features import detect, gradients
from gpvo.matching import IndexedFeatures, StereoFeatures, match_quads
from gpvo.observations import Observations
from gpvo.refinement import patches, refine

Image = NDArray[np.uint8]
NO_LANDMARK = -1


@dataclass(frozen=True, eq=False)
class _Frame:
    """A stereo frame's features, and for each left feature its landmark or NO_LANDMARK."""

    number: int
    features: StereoFeatures
    left_gradient: NDArray[np.uint8]
    right_gradient: NDArray[np.uint8]
    landmark: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Sighting:
    """A landmark's features in one frame."""

    landmark: int
    frame: _Frame
    left: int
    right: int


class Viso2Tracker:
    """Tracks the features of one resolution; see `gpvo.tracking.Tracker`."""

    def __init__(self, config: TrackingConfig) -> None:
        self._features = config.features
        self._config = config.viso2
        self._frames: deque[_Frame] = deque(maxlen=config.earlier_frames)
        self._frame_count = 0
        self._landmark_count = 0
        self._references: dict[int, NDArray[np.uint8]] = {}  # each landmark's first left patch

    def track(self, left: Image, right: Image) -> Observations:
        """Match a new stereo frame with the earlier ones, the latest first."""
        frame = self._new_frame(left, right)
        sightings: list[_Sighting] = []
        for earlier in reversed(self._frames):
            sightings += self._link(frame, earlier)
        self._frames.append(frame)
        observations = self._refined(sightings)
        self._forget()
        return observations

    def _new_frame(self, left: Image, right: Image) -> _Frame:
        height = left.shape[0]
        features = StereoFeatures(
            IndexedFeatures(detect(left, self._features), height),
            IndexedFeatures(detect(right, self._features), height),
        )
        unknown = np.full(len(features.left.features), NO_LANDMARK)
        frame = _Frame(self._frame_count, features, gradients(left), gradients(right), unknown)
        self._frame_count += 1
        return frame

    def _link(self, frame: _Frame, earlier: _Frame) -> list[_Sighting]:
        """Give matched features the same landmark and return the sightings that this adds."""
        quads = match_quads(
            frame.features, earlier.features, frame.number - earlier.number, self._config
        )
        added = []
        for left, right, earlier_right, earlier_left in quads:
            here, there = frame.landmark[left], earlier.landmark[earlier_left]
            if here == NO_LANDMARK and there == NO_LANDMARK:
                here = there = self._new_landmark(earlier, earlier_left)
                added.append(self._sight(there, earlier, earlier_left, earlier_right))
                added.append(self._sight(here, frame, left, right))
            elif here == NO_LANDMARK and there not in frame.landmark:
                added.append(self._sight(there, frame, left, right))
            elif there == NO_LANDMARK and here not in earlier.landmark:
                added.append(self._sight(here, earlier, earlier_left, earlier_right))
        return added

    def _new_landmark(self, frame: _Frame, left: int) -> int:
        point = frame.features.left.features.points[left : left + 1]
        landmark, self._landmark_count = self._landmark_count, self._landmark_count + 1
        self._references[landmark] = patches(frame.left_gradient, point)[0]
        return landmark

    def _forget(self) -> None:
        """Drop the patches of landmarks that are in no frame any more."""
        known = np.unique(np.concatenate([frame.landmark for frame in self._frames])).tolist()
        self._references = {k: self._references[k] for k in known if k != NO_LANDMARK}

    @staticmethod
    def _sight(landmark: int, frame: _Frame, left: int, right: int) -> _Sighting:
        frame.landmark[left] = landmark
        return _Sighting(landmark, frame, left, right)

    def _refined(self, sightings: list[_Sighting]) -> Observations:
        """Sub-pixel observations; those whose patch is not found again are left out."""
        left = np.empty((len(sightings), 2))
        right = np.empty((len(sightings), 2))
        found = np.zeros(len(sightings), bool)
        for frame in {id(s.frame): s.frame for s in sightings}.values():
            rows = np.array([i for i, s in enumerate(sightings) if s.frame is frame])
            reference = np.stack([self._references[sightings[i].landmark] for i in rows])
            left_points = frame.features.left.features.points[[sightings[i].left for i in rows]]
            right_points = frame.features.right.features.points[[sightings[i].right for i in rows]]
            left[rows], found_left = refine(frame.left_gradient, left_points, reference)
            right[rows], found_right = refine(frame.right_gradient, right_points, reference)
            found[rows] = found_left & found_right
        found &= left[:, 0] > right[:, 0]
        return Observations(
            np.array([s.landmark for s in sightings], np.int64)[found],
            np.array([s.frame.number for s in sightings], np.int64)[found],
            left[found],
            right[found],
        )
