"""Observer that keeps one picture of the run: the event image with the most inliers, and tracks."""

from __future__ import annotations

from gpvo.events import ClusterEvents
from gpvo.observer import Step
from gpvo.view.event_image import Image, event_image
from gpvo.view.tracks import TrackHistory, Tracks


class BestPicture:
    """Keeps the left events of the cluster with the most inliers.

    Attributes
    ----------
    tracks
        Tracks that reach into that cluster; None before the first cluster.
    t
        Its end, seconds.
    """

    def __init__(self) -> None:
        self._history = TrackHistory()
        self._inliers = -1
        self._events: ClusterEvents | None = None
        self.tracks: Tracks | None = None
        self.t = 0.0

    def __call__(self, step: Step) -> None:
        """Look at one more cluster."""
        tracks = self._history.add(step.tracked)
        if step.report.inliers > self._inliers:
            self._inliers, self.t = step.report.inliers, step.report.stop
            self._events, self.tracks = step.cluster.left, tracks

    @property
    def image(self) -> Image | None:
        """(height, width, 3) RGB; None before the first cluster."""
        return None if self._events is None else event_image(self._events)
