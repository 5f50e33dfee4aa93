"""Tracking of features around the quad by Lucas-Kanade on smoothed event images.

The circle of section III-A.2 is previous left, current left, current right, previous right and
back. It is closed by the patch around a feature instead of its descriptor. A feature then need not
be detected again in all four images, which few features of a binary frame are.

Then each landmark is matched with its anchor, the image around it where it was seen first, warped
by the motion since: a match with a previous frame adds its error to that of the match before.
Landmarks that were lost are searched by their anchors, too.
"""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from factors.lie import se3_inverse
from gpvo.config import TrackingConfig
from gpvo.second_thread import both
from gpvo.tracking.features import ANY, Crowd, are_near, extrema, smooth, strongest_spaced
from gpvo.tracking.klt.anchors import Anchors
from gpvo.tracking.klt.drifted_search import match_drifted
from gpvo.tracking.klt.following import CHANGED, FINE, KNOWN, follow
from gpvo.tracking.klt.frame import Frame
from gpvo.tracking.klt.lost_landmarks import LostLandmarks
from gpvo.tracking.klt.lucas_kanade import Pyramid, match_patches
from gpvo.tracking.klt.match_precision import MatchPrecision, match_variances
from gpvo.tracking.klt.patch_checks import are_stereo
from gpvo.tracking.klt.pose_information import most_telling, whitened_jacobians
from gpvo.tracking.klt.relocation import refined_pose, relocated_pose
from gpvo.tracking.klt.row_search import search_rows
from gpvo.tracking.klt.surfaces import LEAST_DISPARITY, fit_surfaces, match_on_surfaces
from gpvo.tracking.observations import Observations
from gpvo.tracking.report import TrackingReport
from gpvo.tracking.sights import predict, slopes, warp

Image = NDArray[np.uint8]
Points = NDArray[np.float32]
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


PARTS = 4
"""Parts along each side of the image, whose numbers of first features are limited."""
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
LEAST_SHARE = 0.1
"""Share of contours' events below which matches are taken to scatter no more."""
NO_VARIANCES = np.empty((0, 3))


class KltTracker:
    """Tracker of the features of one resolution; see `gpvo.tracking.Tracker`.

    The camera is in pixels of this resolution.

    Attributes
    ----------
    T_start_cam
        (4, 4) pose of the frame that comes next, by the motion so far. Patches are warped by it.
        After a gap it is found anew.
    noise_share
        Share of the events in the pictures of the frame that comes next that are noise.
    interval
        Time from the latest frame's begin to the next one's, seconds: there is more time for
        features where it is long.
    report
        What became of the features of the latest frame.
    """

    def __init__(self, config: TrackingConfig, camera: StereoCamera) -> None:
        self._config, self._features, self._camera = config.klt, config.features, camera
        self._previous: Frame | None = None
        self._variances, self._precision = NO_VARIANCES, MatchPrecision()
        self._lost = LostLandmarks(self._config.lost_landmarks, camera)
        self._relocations = 0
        self._frame_count = 0
        self._landmark_count = 0
        self._new, self.report = (0, 0), TrackingReport(0, 0, 0, 0)
        self.T_start_cam, self._T_before = np.eye(4), np.eye(4)
        self.noise_share, self.interval = 0.0, 0.0
        self._share, self._spacing = 1.0, 1.0

    def follow(self, left: Image, right: Image) -> Observations:
        """Follow the known landmarks into a new stereo frame, also those that were lost before."""
        images = both(lambda: self._pyramid(left), lambda: self._pyramid(right))
        frame = Frame.without_landmarks(*images, self.T_start_cam)
        known = 0 if self._previous is None else len(self._previous.landmark)
        followed, first_new = self._kept(self._follow(frame)), self._landmark_count
        if self._relocations > 0:
            followed = self._relocated(followed)
        seen = self._with_found_again(followed)
        self._lost.follow(self._previous or seen, seen, first_new)
        self.report = TrackingReport(*self._new, known, len(followed.left))
        if self._previous is not None:
            self._T_before = self._previous.T_start_cam
        self._previous, self.T_start_cam = seen, seen.T_start_cam
        self._frame_count += 1
        return self._observations(seen, NO_VARIANCES)

    def extend(self) -> Observations:
        """Find new landmarks in the latest frame, which tell nothing of the motion yet."""
        seen = self._previous
        if seen is None:
            return Observations.none()
        features = self._detect(seen, self._most_new(seen))
        new = self._in_stereo(features, seen)
        self._new = min(len(features), self._room(seen)), len(new.left)
        self._previous = seen.joined(new)
        return self._observations(new, self._variances)

    def take_back(self) -> None:
        """Forget the latest two frames and all landmarks; no identity is given twice."""
        self._previous, self._variances = None, NO_VARIANCES
        self._precision = MatchPrecision()
        self._lost = LostLandmarks(self._config.lost_landmarks, self._camera)
        self._frame_count -= 2

    def limit_features(self, share: float, spacing: float) -> None:
        """Follow a share of the features, from 0 to 1, that there is time for: those known longest.

        The time is that of frames which are `spacing` times farther apart than they would be. While
        nothing is given up those that are known stay, however little time there is.
        """
        self._share, self._spacing, frame = share, spacing, self._previous
        if frame is not None and share < 1.0 and len(frame.landmark) > self._most:
            self._previous = frame.select(np.arange(len(frame.landmark)) < self._most)

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

    def _follow(self, frame: Frame) -> Frame:
        """Match the landmarks of the previous frame; those that look otherwise get new anchors."""
        previous = self._previous
        if previous is None:
            return frame
        expected = self._predicted(previous, frame), self._warps(frame, previous.anchors)
        given = *expected, self._config, self._closure_tolerance
        left, right, marks = follow(previous, frame, *given)
        known, new = marks == KNOWN, marks == CHANGED
        seen = frame.with_landmarks(previous.landmark, left, right, previous.anchors).select(known)
        changed = self._anchored(frame, previous.landmark[new], left[new], right[new])
        return self._on_surfaces(seen).joined(changed)

    def _anchored(
        self, frame: Frame, landmark: NDArray[np.int64], left: Points, right: Points
    ) -> Frame:
        """Return a frame with landmarks seen first in it, at left and right points (N, 2)."""
        if not self._config.slopes:
            return frame.anchored(landmark, left, right)
        right, slope = fit_surfaces(*frame.images, left, right, self._camera.fx)
        return frame.anchored(landmark, left, right, slope)

    def _on_surfaces(self, frame: Frame) -> Frame:
        """Match left and right again, on the surfaces of the landmarks' anchors."""
        if not self._config.slopes:
            return frame
        slope = slopes(self._camera, frame.T_start_cam, frame.anchors.sights)
        right = match_on_surfaces(*frame.images, frame.left, frame.right, slope)
        return frame.with_landmarks(frame.landmark, frame.left, right, frame.anchors)

    def _predicted(self, previous: Frame, frame: Frame) -> tuple[Points, Points]:
        """Where the motion takes the left and right pixels (N, 2) of the previous frame."""
        there = predict(self._camera, frame.T_start_cam, previous.sights)
        ahead, left = np.isfinite(there[:, :1]), there[:, :2].astype(np.float32)
        return (
            np.where(ahead, left, previous.left),
            np.where(ahead, left - _shift(there), previous.right),
        )

    def _kept(self, followed: Frame) -> Frame:
        """Keep what was followed, unless it may be by chance: then all is lost, and remembered."""
        previous, count = self._previous, len(followed.landmark)
        if previous is None or count >= self._least(len(previous.landmark)):
            return followed
        nothing = followed.select(np.zeros(count, bool))
        self._lost.follow(previous, nothing, self._landmark_count)
        self._previous, self._relocations = nothing, RELOCATED
        return nothing

    def _least(self, known: int) -> float:
        """Return how many of so many known features are not alike by chance."""
        if self.report.closed == 0 and self._relocations == 0:  # they are new: none was lost
            return min(1, known)
        return min(FEW, CHANCE * known)

    def _relocated(self, frame: Frame) -> Frame:
        """Find lost landmarks wherever they are now, and the pose with them."""
        found = self._in_stereo(self._detect(frame, self._room(frame)), frame)
        features, lost = frame.joined(found), self._lost.last
        if lost is None or len(features.landmark) < FEW:
            return frame
        self._relocations -= 1
        T = relocated_pose(self._camera, features, lost, self._config.anchor_correlation)
        for _ in range(REFINEMENTS):
            if T is None:
                return frame
            empty = Frame.without_landmarks(*frame.images, T)
            again = self._with_found_again(empty)
            T = refined_pose(self._camera, again, lost)
        self._relocations = 0
        other = frame.select(~are_near(frame.left, again.left, self._config.spacing))
        return again.joined(self._anchored(again, other.landmark, other.left, other.right))

    def _with_found_again(self, frame: Frame) -> Frame:
        """Add landmarks that were lost, where the motion brings them back into view."""
        config = self._config
        searched = self._lost.in_view(frame) if self._room(frame) > 0 else None
        if searched is None:
            return frame
        lost, there = searched
        given = lost.anchors, self._warps(frame, lost.anchors), frame.left_image
        limits = config.search_tolerance, config.anchor_correlation
        left, alike = match_drifted(*given, there[:, :2].astype(np.float32), *limits)
        known = np.flatnonzero(alike >= config.anchor_correlation)
        lost, there, left, alike = lost[known], there[known], left[known], alike[known]
        right, found = self._in_right(frame, left, left - _shift(there), FINE)
        change = np.abs(left[:, 0] - right[:, 0] - there[:, 2])
        found &= change < 0.5 * config.search_tolerance
        index = self._spaced(left, alike, found, frame)
        again = lost.landmark[index], left[index], right[index], lost.anchors[index]
        return frame.joined(self._on_surfaces(frame.with_landmarks(*again)))

    def _spaced(self, left: Points, alike: Array, found: Mask, frame: Frame) -> NDArray[np.int64]:
        """Return indices of the points (N, 2) found that are most alike, apart from each other."""
        index, room = np.flatnonzero(found), self._room(frame)
        pixels, strength = np.rint(left[index]).astype(np.int32), alike[index].astype(np.float32)
        chosen = strongest_spaced(pixels, strength, frame.left, self._config.spacing, room)
        return index[chosen]

    def _warps(self, frame: Frame, anchors: Anchors) -> NDArray[np.float64]:
        """Warps (N, 3, 2) from the anchors' images to the frame."""
        return warp(self._camera, frame.T_start_cam, anchors.sights)

    def _detect(self, frame: Frame, count: int) -> Points:
        """Return the strongest features (N, 2) of the left image that are not near a landmark.

        At most `count` of them.
        """
        points, _, response = extrema(
            frame.left_image.image, self._features.nms_radius, self._features.response_threshold
        )
        apart = self._config.spacing, count, self._crowd(frame)
        chosen = strongest_spaced(points, response, frame.left, *apart)
        return points[chosen].astype(np.float32)

    def _crowd(self, frame: Frame) -> Crowd:
        """Return how many features each part of the image may have: the first ones are spread."""
        if self._config.crowding is None or len(frame.landmark):
            return ANY
        height, width = (-(-side // PARTS) for side in frame.left_image.image.shape)
        return Crowd(width, height, ceil(self._config.crowding * self._most / PARTS**2))

    @property
    def _most(self) -> int:
        """Number of landmarks that a frame may have."""
        return int(self._share * self._config.features(self.interval / self._spacing))

    def _room(self, frame: Frame) -> int:
        """Return how many more landmarks a frame may have."""
        return max(self._most - len(frame.landmark), 0)

    def _most_new(self, frame: Frame) -> int:
        """Return how many new features are looked at: more than there is room for, if any.

        The first ones are spread, as nothing is known of the motion.
        """
        more = self._config.candidates if len(frame.landmark) else 1.0
        return int(more * self._room(frame))

    def _in_stereo(self, left: Points, frame: Frame) -> Frame:
        """Make landmarks of the left features (N, 2) that have a match in the right image."""
        guess, known = search_rows(*frame.images, left)
        left, guess = self._most_telling(left[known], guess[known], frame)
        right, new = self._in_right(frame, left, guess, self._config.pyramid_levels)
        landmark = self._landmark_count + np.arange(new.sum())
        self._landmark_count += len(landmark)
        return self._anchored(frame, landmark, left[new], right[new])

    def _most_telling(self, left: Points, guess: Points, frame: Frame) -> tuple[Points, Points]:
        """Choose as many left points (N, 2), and right ones, as a frame has room for.

        Those that tell most of the pose beside its landmarks.
        """
        room = self._room(frame)
        if len(left) <= room:
            return left, guess
        known, T_before_now = frame.sights.measured, se3_inverse(self._T_before) @ frame.T_start_cam
        disparity = np.maximum(left[:, 0] - guess[:, 0], LEAST_DISPARITY)
        measured = np.concatenate([known, np.column_stack([left, disparity])])
        shape = frame.left_image.image.shape
        rows = whitened_jacobians(self._camera, T_before_now, shape, measured)
        chosen = most_telling(rows, len(known), room)
        return left[chosen], guess[chosen]

    def _in_right(
        self, frame: Frame, left: Points, guess: Points, coarser: int
    ) -> tuple[Points, Mask]:
        """Return the right points (N, 2) of left ones, and which lead back and are stereo.

        The search begins at the guess (N, 2), at most `coarser` levels above the image.
        """
        right, found = match_patches(*frame.images, left, guess, coarser)
        again = *frame.images[::-1], right, right + (left - guess)
        back, found_back = match_patches(*again, coarser)
        closed = np.linalg.norm(back - left, axis=1) < self._closure_tolerance
        return right, found & found_back & closed & self._is_stereo(frame, left, right)

    @property
    def _closure_tolerance(self) -> float:
        """Matches scatter by the inverse of the contours' share in the picture."""
        return self._config.closure_tolerance / max(LEAST_SHARE, 1 - self.noise_share)

    def _is_stereo(self, frame: Frame, left: Points, right: Points) -> Mask:
        images = frame.left_image.image, frame.right_image.image
        return are_stereo(images, left, right, self._config)


def _shift(measurements: Array) -> Points:
    """Return left minus right pixels (N, 2) of measurements (u_left, v, disparity)."""
    return (measurements[:, 2:] * [1.0, 0.0]).astype(np.float32)
