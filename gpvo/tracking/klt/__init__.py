"""Features followed by patches on images, by Lucas and Kanade."""

from gpvo.tracking.klt.tracker import KltTracker

__all__ = ["KltTracker"]
