"""Tracking of features event by event, after HASTE."""

from gpvo.tracking.haste.tracker import EventTracker

__all__ = ["EventTracker"]
