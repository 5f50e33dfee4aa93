"""Tracking of LIBVISO2's features by circular descriptor matching, the paper's front end.

Section III-A.2: new quad matches with the previous frame start or continue tracklets, matches with
a number of earlier frames extend them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.config import FeatureConfig, TrackingConfig
from gpvo.tracking.features import detect, gradients, smooth
from gpvo.tracking.observations import Observations
from gpvo.tracking.report import TrackingReport
from gpvo.tracking.viso2.bucketing import best_per_cell
from gpvo.tracking.viso2.quad_matching import (
    StereoFeatures,
    index_features,
    match_quads,
    quad_points,
    stereo_matches,
)
from gpvo.tracking.viso2.search_ranges import everywhere, near_matches
from gpvo.tracking.viso2.subpixel_refinement import PATCH, patches, refine

Image = NDArray[np.uint8]
NO_LANDMARK = -1


@dataclass(frozen=True, eq=False)
class _Frame:
    """Features of a stereo frame, with the landmark and the right feature of each left one.

    The landmark is NO_LANDMARK if there is none. The sparse features, if any, are those of the
    first stage.
    """

    number: int
    features: StereoFeatures
    sparse: StereoFeatures | None
    left_gradient: NDArray[np.uint8]
    right_gradient: NDArray[np.uint8]
    landmark: NDArray[np.int64]
    right: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Sightings:
    """Landmarks (N,) that a frame shows, and their left and right features (N,)."""

    frame: _Frame
    landmark: NDArray[np.int64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]


class Viso2Tracker:
    """Tracker of the features of one resolution; see `gpvo.tracking.Tracker`."""

    def __init__(self, config: TrackingConfig) -> None:
        self._features = config.features
        self._config = config.viso2
        self._sparse = config.features.model_copy(
            update={"nms_radius": config.viso2.sparse_nms_radius}
        )
        self._frames: deque[_Frame] = deque(maxlen=config.earlier_frames)
        self._frame_count = 0
        self._landmark_count = 0
        self.report = TrackingReport(0, 0, 0, 0)
        self._references: dict[int, NDArray[np.uint8]] = {}  # each landmark's first left patch

    def track(self, left: Image, right: Image) -> Observations:
        """Match a new stereo frame with the earlier ones, the latest first."""
        frame = self._new_frame(left, right)
        sightings = [_see(frame, *np.empty((3, 0), np.int64))]
        for earlier in reversed(self._frames):
            sightings += self._link(frame, earlier)
        self.report = self._counted(frame)
        self._frames.append(frame)
        observations = Observations.concatenate([self._refined(seen) for seen in sightings])
        self._forget()
        return observations

    def _new_frame(self, left: Image, right: Image) -> _Frame:
        if self._config.smoothing > 0:
            left, right = (smooth(image, self._config.smoothing) for image in (left, right))
        features = _detect(left, right, self._features)
        unknown = np.full(len(features.left.features), NO_LANDMARK)
        frame = _Frame(
            self._frame_count,
            features,
            _detect(left, right, self._sparse) if self._config.two_stage else None,
            gradients(left),
            gradients(right),
            unknown,
            unknown.copy(),
        )
        self._frame_count += 1
        return frame

    def _counted(self, frame: _Frame) -> TrackingReport:
        """Count what was found in a frame that is linked with the earlier ones."""
        ranges = everywhere(frame.left_gradient.shape[:2], 1, self._config)
        stereo = stereo_matches(frame.features, ranges)
        latest = self._frames[-1] if self._frames else None
        return TrackingReport(
            len(frame.landmark),
            len(stereo),
            0 if latest is None else len(latest.landmark),
            0 if latest is None else len(_known_quads(frame, latest)),
        )

    def _match(self, frame: _Frame, earlier: _Frame) -> NDArray[np.int64]:
        """Match two frames and return quads (M, 4) like `match_quads`."""
        shape, between = frame.left_gradient.shape[:2], frame.number - earlier.number
        ranges = everywhere(shape, between, self._config)
        if frame.sparse is not None and earlier.sparse is not None:
            sparse = match_quads(frame.sparse, earlier.sparse, ranges, self._config)
            points = np.concatenate(
                [
                    quad_points(sparse, frame.sparse, earlier.sparse),
                    quad_points(_known_quads(frame, earlier), frame.features, earlier.features),
                ],
                axis=1,
            )
            ranges = near_matches(points, ranges, self._config.least_range)
        return match_quads(frame.features, earlier.features, ranges, self._config)

    def _bucketed(
        self, quads: NDArray[np.int64], frame: _Frame, earlier: _Frame
    ) -> NDArray[np.int64]:
        """Drop the quads (M, 4) that would give a cell of the frame too many landmarks."""
        if self._config.bucket_features == 0:
            return quads
        features = frame.features.left.features
        keep = frame.landmark[quads[:, 0]] != NO_LANDMARK
        new, landmark = quads[~keep, 0], earlier.landmark[quads[~keep, 3]]
        keep[~keep] = best_per_cell(
            features.points[new],
            (self._sightings(landmark), features.strength[new]),
            features.points[frame.landmark != NO_LANDMARK],
            self._config.bucket_size,
            self._config.bucket_features,
        )
        return quads[keep]

    def _sightings(self, landmark: NDArray[np.int64]) -> NDArray[np.int64]:
        """Count the earlier frames (N,) in which landmarks (N,) are seen."""
        known = np.concatenate([frame.landmark for frame in self._frames])
        return (landmark[:, None] == known).sum(axis=1) * (landmark != NO_LANDMARK)

    def _link(self, frame: _Frame, earlier: _Frame) -> list[_Sightings]:
        """Give matched features the same landmark and return the sightings that this adds."""
        quads = self._bucketed(self._match(frame, earlier), frame, earlier)
        left, right, earlier_right, earlier_left = quads.T
        here, there = frame.landmark[left], earlier.landmark[earlier_left]
        unknown_here, unknown_there = here == NO_LANDMARK, there == NO_LANDMARK
        new = unknown_here & unknown_there
        here[new] = there[new] = self._new_landmarks(earlier, earlier_left[new])
        onward = unknown_here & ~np.isin(there, frame.landmark)
        backward = unknown_there & ~np.isin(here, earlier.landmark)
        return [
            _see(earlier, here[backward], earlier_left[backward], earlier_right[backward]),
            _see(frame, there[onward], left[onward], right[onward]),
        ]

    def _new_landmarks(self, frame: _Frame, left: NDArray[np.int64]) -> NDArray[np.int64]:
        """Create landmarks (N,) for left features (N,) of a frame."""
        landmarks = self._landmark_count + np.arange(len(left))
        self._landmark_count += len(left)
        references = patches(frame.left_gradient, frame.features.left.features.points[left])
        self._references.update(zip(landmarks.tolist(), references, strict=True))
        return landmarks

    def _forget(self) -> None:
        """Drop the patches of landmarks that are in no frame any more."""
        known = np.unique(np.concatenate([frame.landmark for frame in self._frames])).tolist()
        self._references = {k: self._references[k] for k in known if k != NO_LANDMARK}

    def _refined(self, seen: _Sightings) -> Observations:
        """Refine observations and drop those whose patch is not found again."""
        frame, how = seen.frame, self._config.refinement
        references = [self._references[landmark] for landmark in seen.landmark.tolist()]
        reference = np.array(references, np.uint8).reshape(-1, len(PATCH))
        left_points = frame.features.left.features.points[seen.left]
        right_points = frame.features.right.features.points[seen.right]
        left, found_left = refine(frame.left_gradient, left_points, reference, how)
        right, found_right = refine(frame.right_gradient, right_points, reference, how)
        found = found_left & found_right & (left[:, 0] > right[:, 0])
        number = np.full(len(seen.landmark), frame.number)
        return Observations(seen.landmark[found], number[found], left[found], right[found])


def _see(
    frame: _Frame, landmark: NDArray[np.int64], left: NDArray[np.int64], right: NDArray[np.int64]
) -> _Sightings:
    """Record landmarks (N,) in a frame."""
    frame.landmark[left], frame.right[left] = landmark, right
    return _Sightings(frame, landmark, left, right)


def _detect(left: Image, right: Image, config: FeatureConfig) -> StereoFeatures:
    found = (index_features(detect(image, config), len(image)) for image in (left, right))
    return StereoFeatures(*found)


def _known_quads(frame: _Frame, earlier: _Frame) -> NDArray[np.int64]:
    """Return the quads (M, 4) of the landmarks that both frames show."""
    landmark, here, there = np.intersect1d(frame.landmark, earlier.landmark, return_indices=True)
    here, there = (index[landmark != NO_LANDMARK] for index in (here, there))
    return np.stack([here, frame.right[here], earlier.right[there], there], axis=1)
