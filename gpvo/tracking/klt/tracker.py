"""Tracking of features around the quad by Lucas-Kanade on smoothed event images.

The circle of section III-A.2 is previous left, current left, current right, previous right and
back. It is closed by the patch around a feature instead of its descriptor. A feature then need not
be detected again in all four images, which few features of a binary frame are.

Then each landmark is matched with its anchor, the image around it where it was seen first, warped
by the motion since: a match with a previous frame adds its error to that of the match before.
Landmarks that were lost are searched by their anchors, too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.config import TrackingConfig
from gpvo.second_thread import both
from gpvo.tracking.features import smooth
from gpvo.tracking.klt.feature_count import FeatureCount
from gpvo.tracking.klt.following import CHANGED, KNOWN, follow
from gpvo.tracking.klt.frame import Frame
from gpvo.tracking.klt.known_again import KnownAgain
from gpvo.tracking.klt.lucas_kanade import Pyramid
from gpvo.tracking.klt.match_precision import MatchPrecision, match_variances
from gpvo.tracking.klt.new_landmarks import NewLandmarks
from gpvo.tracking.klt.stereo_matches import StereoMatches, shift
from gpvo.tracking.observations import Observations
from gpvo.tracking.report import TrackingReport
from gpvo.tracking.sights import predict, warp

Image = NDArray[np.uint8]
Points = NDArray[np.float32]
Array = NDArray[np.float64]

NO_VARIANCES = np.empty((0, 3))


class KltTracker:
    """Tracker of the features of one resolution; see `gpvo.tracking.Tracker`.

    The camera is in pixels of this resolution.

    Attributes
    ----------
    T_start_cam
        (4, 4) pose of the frame that comes next, by the motion so far. Patches are warped by it.
        After a gap it is found anew.
    allowed
        How many features frames have.
    stereo
        Matches between left and right.
    report
        What became of the features of the latest frame.
    """

    def __init__(self, config: TrackingConfig, camera: StereoCamera) -> None:
        self._config, self._camera = config.klt, camera
        self.allowed, self.stereo = FeatureCount(config.klt), StereoMatches(config.klt, camera)
        self._new = NewLandmarks(config, camera, self.allowed, self.stereo)
        self._again = KnownAgain(config.klt, camera, self.allowed, self.stereo, self._new)
        self._previous: Frame | None = None
        self._variances, self._precision = NO_VARIANCES, MatchPrecision()
        self._frame_count = 0
        self._found, self.report = (0, 0), TrackingReport(0, 0, 0, 0)
        self.T_start_cam = np.eye(4)

    def follow(self, left: Image, right: Image) -> Observations:
        """Follow the known landmarks into a new stereo frame, also those that were lost before."""
        images = both(lambda: self._pyramid(left), lambda: self._pyramid(right))
        frame = Frame.without_landmarks(*images, self.T_start_cam)
        before, first_new = self._previous or frame, self._new.count
        known, followed = len(before.landmark), self._follow(before, frame)
        if self._again.by_chance(len(followed.landmark), known, self.report.closed == 0):
            self._again.lose_all(before, frame, first_new)
            before = followed = frame
        followed = self._again.relocated(followed)
        seen = self._again.added_to(followed)
        self._again.follow(before, seen, first_new)
        self.report = TrackingReport(*self._found, known, len(followed.left))
        self._new.T_before = before.T_start_cam
        self._previous, self.T_start_cam = seen, seen.T_start_cam
        self._frame_count += 1
        return self._observations(seen, NO_VARIANCES)

    def extend(self) -> Observations:
        """Find new landmarks in the latest frame, which tell nothing of the motion yet."""
        seen = self._previous
        if seen is None:
            return Observations.none()
        features, room = self._new.detect(seen), self.allowed.room(seen)
        new = self._new.in_stereo(features, seen)
        self._found = min(len(features), room), len(new.left)
        self._previous = seen.joined(new)
        return self._observations(new, self._variances)

    def take_back(self) -> None:
        """Forget the latest two frames and all landmarks; no identity is given twice."""
        self._previous, self._variances = None, NO_VARIANCES
        self._precision = MatchPrecision()
        self._again.forget()
        self._frame_count -= 2

    def limit_features(self, share: float, spacing: float) -> None:
        """Follow a share of the features that there is time for, see `FeatureCount.limit`.

        Those known longest. While nothing is given up those that are known stay, however little
        time there is.
        """
        self.allowed.limit(share, spacing)
        if self._previous is not None and share < 1.0:
            self._previous = self.allowed.first_known(self._previous)

    def _observations(self, seen: Frame, others: Array) -> Observations:
        """Return where landmarks of the latest frame are seen, and how precisely.

        `others` (M, 3) are the variances of its other landmarks.
        """
        return Observations(
            seen.landmark,
            np.full(len(seen.landmark), self._frame_count - 1),
            seen.left.astype(np.float64),
            seen.right.astype(np.float64),
            own_deviations=self._deviations(seen, others) if self._config.deviations else None,
        )

    def _deviations(self, seen: Frame, others: Array) -> Array:
        """Compute relative standard deviations (N, 3) of landmarks, and keep their variances."""
        self._variances = match_variances(*seen.images, seen.left, seen.right)
        return self._precision.deviations(self._variances, others)

    def _pyramid(self, image: Image) -> Pyramid:
        smoothed = smooth(image, self._config.smoothing)
        return Pyramid.of_image(smoothed, self._config.side, self._config.pyramid_levels)

    def _follow(self, before: Frame, frame: Frame) -> Frame:
        """Match the landmarks of the frame before; those that look otherwise get new anchors."""
        warps = warp(self._camera, frame.T_start_cam, before.anchors.sights)
        given = self._predicted(before, frame), warps, self._config, self.stereo.closure_tolerance
        left, right, marks = follow(before, frame, *given)
        known, new = marks == KNOWN, marks == CHANGED
        seen = frame.with_landmarks(before.landmark, left, right, before.anchors).select(known)
        changed = self.stereo.anchored(frame, before.landmark[new], left[new], right[new])
        return self.stereo.on_surfaces(seen).joined(changed)

    def _predicted(self, before: Frame, frame: Frame) -> tuple[Points, Points]:
        """Where the motion takes the left and right pixels (N, 2) of the frame before."""
        there = predict(self._camera, frame.T_start_cam, before.sights)
        ahead, left = np.isfinite(there[:, :1]), there[:, :2].astype(np.float32)
        return (
            np.where(ahead, left, before.left),
            np.where(ahead, left - shift(there), before.right),
        )
