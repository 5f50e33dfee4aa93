"""Tracking of features by image patches, after Lucas and Kanade."""

from gpvo.tracking.klt.tracker import KltTracker

__all__ = ["KltTracker"]
