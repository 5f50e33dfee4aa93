"""Tracking of landmarks through clusters, each measured at its own time, section III-A.2."""

from gpvo.tracking.ego_motion import EgoMotion
from gpvo.tracking.image_acceleration import ImageAcceleration
from gpvo.tracking.measurements import Measurements, seen_twice
from gpvo.tracking.observations import Observations
from gpvo.tracking.report import TrackingReport
from gpvo.tracking.tracker import MultiResolutionTracker, Tracker
from gpvo.tracking.tracklets import Tracklets

__all__ = [
    "EgoMotion",
    "ImageAcceleration",
    "Measurements",
    "MultiResolutionTracker",
    "Observations",
    "Tracker",
    "TrackingReport",
    "Tracklets",
    "seen_twice",
]
