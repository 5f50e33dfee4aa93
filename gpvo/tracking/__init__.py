"""Tracking of landmarks through clusters, each measured at its own time, section III-A.2."""

from gpvo.tracking.measurements import Measurements, seen_twice
from gpvo.tracking.observations import Observations
from gpvo.tracking.tracker import Tracker, make_tracker
from gpvo.tracking.tracklets import Tracklets

__all__ = [
    "Measurements",
    "Observations",
    "Tracker",
    "Tracklets",
    "make_tracker",
    "seen_twice",
]
