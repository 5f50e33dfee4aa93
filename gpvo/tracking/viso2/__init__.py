"""Tracking of features by descriptors around the quad, after viso2."""

from gpvo.tracking.viso2.tracker import Viso2Tracker

__all__ = ["Viso2Tracker"]
