"""Observer that keeps one picture of the run: the event image with the most inliers, and tracks."""

from __future__ import annotations

from gpvo.observer import Step
from gpvo.view.event_image import Image, event_image
from gpvo.view.tracks import Track, TrackHistory


class BestPicture:
    """Keeps the left event image of the cluster with the most inliers.

    Attributes
    ----------
    image
        (height, width, 3) RGB; None before the first cluster.
    tracks
        Tracks that reach into that cluster.
    t
        Its end, seconds.
    """

    def __init__(self) -> None:
        self._history = TrackHistory()
        self._inliers = -1
        self.image: Image | None = None
        self.tracks: list[Track] = []
        self.t = 0.0

    def __call__(self, step: Step) -> None:
        """Look at one more cluster."""
        tracks = self._history.add(step.tracked)
        if step.report.inliers > self._inliers:
            self._inliers, self.t = step.report.inliers, step.report.stop
            self.image, self.tracks = event_image(step.cluster.left), tracks
