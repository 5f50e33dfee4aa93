"""Report of what a tracker found in one cluster, which tells where landmarks are lost."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TrackingReport:
    """What a tracker found in one cluster.

    Attributes
    ----------
    features
        New features in the left picture, or in that of the cluster before until they are found.
    stereo
        Those of them that have a match in the right picture.
    known
        Features of the cluster before, to be followed.
    closed
        Those of them that were followed around the quad.
    at_rest
        Nothing moved: the pictures are those of the cluster before.
    turns
        Contours hardly moved in it or in the one before: what motion comes is unknown.
    thinned
        Events that the pictures leave out because there are enough; both cameras.
    """

    features: int
    stereo: int
    known: int
    closed: int
    at_rest: bool = False
    turns: bool = False
    thinned: int = 0

    def __add__(self, other: TrackingReport) -> TrackingReport:
        """Return the report of two trackers of the same cluster."""
        return TrackingReport(
            self.features + other.features,
            self.stereo + other.stereo,
            self.known + other.known,
            self.closed + other.closed,
            self.at_rest and other.at_rest,
            self.turns and other.turns,
            max(self.thinned, other.thinned),
        )
