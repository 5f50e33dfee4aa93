"""Landmarks known again: where the motion takes them, and anywhere after all were lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.config.stages import KltConfig
from gpvo.tracking.features import are_near, strongest_spaced
from gpvo.tracking.klt.drifted_search import match_drifted
from gpvo.tracking.klt.feature_count import FeatureCount
from gpvo.tracking.klt.following import FINE
from gpvo.tracking.klt.frame import Frame
from gpvo.tracking.klt.lost_landmarks import LostLandmarks
from gpvo.tracking.klt.new_landmarks import NewLandmarks
from gpvo.tracking.klt.relocation import refined_pose, relocated_pose
from gpvo.tracking.klt.stereo_matches import StereoMatches, shift
from gpvo.tracking.sights import warp

Points = NDArray[np.float32]
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FEW = 30
"""Number of features below which there is nothing to be known again."""
CHANCE = 0.1
"""Share of the known features below which those that were followed may be alike by chance.

After 72 breaks of 0.3 to 1.2 s, places were 0.13 times as far off as with those kept.
"""
RELOCATED = 10
"""Number of frames with features after that in which lost landmarks are searched anywhere."""
REFINEMENTS = 3
"""Times that they are searched where a pose has them, which is refined by those that are found."""


class KnownAgain:
    """Remembers the landmarks that were lost, and finds them again."""

    def __init__(
        self,
        config: KltConfig,
        camera: StereoCamera,
        allowed: FeatureCount,
        stereo: StereoMatches,
        new: NewLandmarks,
    ) -> None:
        self._config, self._camera = config, camera
        self._allowed, self._stereo, self._new = allowed, stereo, new
        self._lost, self._relocations = LostLandmarks(config.lost_landmarks, camera), 0

    def forget(self) -> None:
        """Forget all landmarks."""
        self._lost = LostLandmarks(self._config.lost_landmarks, self._camera)

    def follow(self, before: Frame, seen: Frame, first_new: int) -> None:
        """Remember what was lost between two frames; identities from `first_new` on are new."""
        self._lost.follow(before, seen, first_new)

    def by_chance(self, followed: int, known: int, are_new: bool) -> bool:
        """Tell whether so few of those known were followed that they may be alike by chance.

        Where all that are known are new, none is lost.
        """
        if are_new and self._relocations == 0:
            return followed < min(1, known)
        return followed < min(FEW, CHANCE * known)

    def lose_all(self, before: Frame, frame: Frame, first_new: int) -> None:
        """Remember all landmarks as lost; search them wherever they may be, in the next frames."""
        self.follow(before, frame, first_new)
        self._relocations = RELOCATED

    def relocated(self, frame: Frame) -> Frame:
        """Find lost landmarks wherever they are now, and the pose with them, if that is due."""
        if self._relocations == 0:
            return frame
        found = self._new.in_stereo(self._new.strongest(frame, self._allowed.room(frame)), frame)
        features, lost = frame.joined(found), self._lost.last
        if lost is None or len(features.landmark) < FEW:
            return frame
        self._relocations -= 1
        T = relocated_pose(self._camera, features, lost, self._config.anchor_correlation)
        for _ in range(REFINEMENTS):
            if T is None:
                return frame
            again = self.added_to(Frame.without_landmarks(*frame.images, T))
            T = refined_pose(self._camera, again, lost)
        self._relocations = 0
        other = frame.select(~are_near(frame.left, again.left, self._config.spacing))
        return again.joined(self._stereo.anchored(again, other.landmark, other.left, other.right))

    def added_to(self, frame: Frame) -> Frame:
        """Add landmarks that were lost, where the motion brings them back into view."""
        config = self._config
        searched = self._lost.in_view(frame) if self._allowed.room(frame) > 0 else None
        if searched is None:
            return frame
        lost, there = searched
        warps = warp(self._camera, frame.T_start_cam, lost.anchors.sights)
        given = lost.anchors, warps, frame.left_image, there[:, :2].astype(np.float32)
        left, alike = match_drifted(*given, config.search_tolerance, config.anchor_correlation)
        known = np.flatnonzero(alike >= config.anchor_correlation)
        lost, there, left, alike = lost[known], there[known], left[known], alike[known]
        right, found = self._stereo.in_right(frame, left, left - shift(there), FINE)
        change = np.abs(left[:, 0] - right[:, 0] - there[:, 2])
        found &= change < 0.5 * config.search_tolerance
        index = self._spaced(left, alike, found, frame)
        again = lost.landmark[index], left[index], right[index], lost.anchors[index]
        return frame.joined(self._stereo.on_surfaces(frame.with_landmarks(*again)))

    def _spaced(self, left: Points, alike: Array, found: Mask, frame: Frame) -> NDArray[np.int64]:
        """Return indices of the points (N, 2) found that are most alike, apart from each other."""
        index, room = np.flatnonzero(found), self._allowed.room(frame)
        pixels, strength = np.rint(left[index]).astype(np.int32), alike[index].astype(np.float32)
        chosen = strongest_spaced(pixels, strength, frame.left, self._config.spacing, room)
        return index[chosen]
