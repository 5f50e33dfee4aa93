"""Trackers, which observe landmarks in stereo clusters by features of any kind.

Section III-A.2 of the paper: any feature detector and tracker can be used.
"""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from operator import add
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.config import TrackingConfig
from gpvo.events import StereoCluster
from gpvo.second_thread import Begun
from gpvo.tracking.ego_motion import EgoMotion, camera_of_pixels
from gpvo.tracking.features import half_resolution
from gpvo.tracking.klt import KltTracker
from gpvo.tracking.motion_compensation import MotionCompensation
from gpvo.tracking.observations import Observations
from gpvo.tracking.report import TrackingReport
from gpvo.tracking.viso2 import Viso2Tracker

StereoImage = tuple[NDArray[np.uint8], NDArray[np.uint8]]


class Tracker(Protocol):
    """Tracker that follows features through clusters, given in order of time.

    Any object with this method is a tracker: `Odometry(rig, tracker=mine)`. An attribute `report`,
    a `TrackingReport` of the latest cluster, if it has one, helps to say where landmarks are lost.
    An attribute `motion`, an `EgoMotion`, if it has one, is told the velocity and the pose.
    """

    def track(self, cluster: StereoCluster) -> Observations:
        """Return the observations that a new cluster adds.

        They are in it or in the `tracking.earlier_frames` clusters before it.
        """
        ...


class MultiResolutionTracker:
    """The configured image tracker at one or more resolutions, run independently.

    Positions are full-resolution pixels. `motion` knows the velocity of the latest cluster; patches
    are warped by it.
    """

    def __init__(self, config: TrackingConfig, camera: StereoCamera) -> None:
        self.motion = EgoMotion()
        self._trackers = [
            _ResolutionTracker(config, side, camera) for side in config.resolutions or (1,)
        ]

    def track(self, cluster: StereoCluster) -> Observations:
        """Return the observations that a new cluster adds, in it or in earlier clusters."""
        self.motion.advance(cluster.middle)
        parts = [tracker.track(cluster, self.motion) for tracker in self._trackers]
        return Observations.concatenate(
            replace(found, landmark=found.landmark * len(parts) + index)
            for index, found in enumerate(parts)
        )

    def limit_features(self, share: float, spacing: float = 1.0) -> None:
        """Look for a share of the configured features, from 0 to 1; LIBVISO2's has no limit.

        Clusters are so many times farther apart than usual, which is no time for more.
        """
        for tracker in self._trackers:
            tracker.limit_features(share, spacing)

    @property
    def report(self) -> TrackingReport:
        """Report of the latest cluster, of all resolutions together."""
        return reduce(add, (tracker.report for tracker in self._trackers))


class _ResolutionTracker:
    """Image tracker at one resolution; its pixels are `side` full pixels wide.

    New landmarks of a cluster tell nothing of the motion before they are followed into the next
    one: they are found meanwhile, and returned with those. The first two clusters tell by how much
    the events of both are to be moved: if that is far, they are tracked again with sharp pictures.
    """

    def __init__(self, config: TrackingConfig, side: int, camera: StereoCamera) -> None:
        self._side, self._image = side, config.image
        self._tracker: KltTracker | Viso2Tracker
        if config.tracker == "klt":
            self._tracker = KltTracker(config, camera_of_pixels(camera, side))
        else:
            self._tracker = Viso2Tracker(config)
        self._compensation = MotionCompensation(
            config.compensation, config.earlier_frames + 1, side
        )
        self._new = Begun(Observations.none)
        self._before: StereoCluster | None = None

    def track(self, cluster: StereoCluster, motion: EgoMotion) -> Observations:
        """Return the observations that a cluster adds, full-resolution pixels."""
        if not isinstance(self._tracker, KltTracker):
            return self._measured(self._tracker.track(*self._images(cluster)))
        observations = self._tracked(self._tracker, cluster, motion)
        if self._compensation.blurred and self._before is not None:
            self._take_back(self._tracker)
            for again in (self._before, cluster):
                observations = self._tracked(self._tracker, again, motion)
        self._before = cluster
        return observations

    def _tracked(
        self, tracker: KltTracker, cluster: StereoCluster, motion: EgoMotion
    ) -> Observations:
        """Follow features into a cluster; return them, and those found new in the one before."""
        images = self._images(cluster)
        found = self._measured(self._new.result())
        if self._before is not None and self._before is not cluster:
            tracker.allowed.interval = cluster.start - self._before.start
        followed = self._measured(_follow(tracker, images, cluster.noise_share, motion))
        self._new = Begun(tracker.extend)
        return Observations.concatenate([found, followed])

    def _take_back(self, tracker: KltTracker) -> None:
        """Forget the latest two clusters but for the image motion."""
        self._new.result()  # so that identities do not depend on a thread
        self._new = Begun(Observations.none)
        self._compensation.take_back()
        tracker.take_back()

    def _measured(self, seen: Observations) -> Observations:
        """Return observations at their own times, in full-resolution pixels."""
        if self._image == "motion_compensated":
            seen = self._compensation.timed(seen)
        return replace(
            seen,
            left=to_full_resolution(seen.left, self._side),
            right=to_full_resolution(seen.right, self._side),
        )

    def limit_features(self, share: float, spacing: float) -> None:
        """Look for a share of the configured features."""
        if isinstance(self._tracker, KltTracker):
            self._new.result()  # the features are in use until then
            self._tracker.limit_features(share, spacing)

    @property
    def report(self) -> TrackingReport:
        """Report of the latest cluster."""
        seen = self._compensation
        return replace(
            self._tracker.report, at_rest=seen.at_rest, turns=seen.turns, thinned=seen.thinned
        )

    def _images(self, cluster: StereoCluster) -> StereoImage:
        if self._image == "motion_compensated":
            return self._compensation.pictures(cluster)
        left, right = (
            side.binary_frame
            if self._image == "binary"
            else side.time_surface(cluster.start, cluster.stop)
            for side in (cluster.left, cluster.right)
        )
        return (left, right) if self._side == 1 else (half_resolution(left), half_resolution(right))


def _follow(
    tracker: KltTracker, images: StereoImage, noise_share: float, motion: EgoMotion
) -> Observations:
    """Follow features to a pose, which may be found anew."""
    tracker.T_start_cam, tracker.stereo.noise_share = motion.T_start_cam, noise_share
    seen = tracker.follow(*images)
    if tracker.T_start_cam is not motion.T_start_cam:
        motion.relocate(tracker.T_start_cam)
    return seen


def to_full_resolution(points: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """Return the full-resolution position of pixels that are `side` full pixels wide."""
    return points * side + (side - 1) / 2
