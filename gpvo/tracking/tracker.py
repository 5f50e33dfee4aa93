"""Trackers, which observe landmarks in stereo clusters by features of any kind.

Section III-A.2 of the paper: any feature detector and tracker can be used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gpvo.config import TrackingConfig
from gpvo.events import StereoCluster
from gpvo.tracking.features import half_resolution
from gpvo.tracking.klt import KltTracker
from gpvo.tracking.motion_compensation import MotionCompensation
from gpvo.tracking.observations import Observations
from gpvo.tracking.viso2 import Viso2Tracker

StereoImage = tuple[NDArray[np.uint8], NDArray[np.uint8]]


class Tracker(Protocol):
    """Tracker that follows features through clusters, given in order of time.

    Any object with this method is a tracker: `Odometry(rig, tracker=mine)`.
    """

    def track(self, cluster: StereoCluster) -> Observations:
        """Return the observations that a new cluster adds, in it or in earlier clusters."""
        ...


class ImageTracker(Protocol):
    """Tracker that follows features through pairs of stereo images, given in order of time."""

    def track(self, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> Observations:
        """Return the observations that a new pair of images adds."""
        ...


def make_tracker(config: TrackingConfig) -> Tracker:
    """Make the tracker that the configuration names."""
    return MultiResolutionTracker(config)


class MultiResolutionTracker:
    """Image trackers at several resolutions, run independently.

    Positions are full-resolution pixels.
    """

    def __init__(self, config: TrackingConfig) -> None:
        make = KltTracker if config.tracker == "klt" else Viso2Tracker
        self._image = config.image
        self._compensation = MotionCompensation(config.compensation, config.earlier_frames + 1)
        self._resolutions = config.resolutions
        self._trackers: Sequence[ImageTracker] = [make(config) for _ in config.resolutions]

    def track(self, cluster: StereoCluster) -> Observations:
        """Return the observations that a new cluster adds."""
        full = self._images(cluster)
        parts = []
        for index, (resolution, tracker) in enumerate(
            zip(self._resolutions, self._trackers, strict=True)
        ):
            left, right = full if resolution == 1 else map(half_resolution, full)
            found = tracker.track(left, right)
            parts.append(
                replace(
                    found,
                    landmark=found.landmark * len(self._trackers) + index,
                    left=to_full_resolution(found.left, resolution),
                    right=to_full_resolution(found.right, resolution),
                )
            )
        seen = Observations.concatenate(parts)
        return self._compensation.timed(seen) if self._image == "motion_compensated" else seen

    def _images(self, cluster: StereoCluster) -> StereoImage:
        if self._image == "motion_compensated":
            return self._compensation.pictures(cluster)
        if self._image == "binary":
            return cluster.left.binary_frame, cluster.right.binary_frame
        left, right = (
            side.time_surface(cluster.start, cluster.stop) for side in (cluster.left, cluster.right)
        )
        return left, right


def to_full_resolution(points: NDArray[np.float64], resolution: int) -> NDArray[np.float64]:
    """Return the full-resolution position of pixels whose side is `resolution` full pixels."""
    return points * resolution + (resolution - 1) / 2
