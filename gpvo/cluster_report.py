"""Report of what became of one cluster, from its events to the measurements of inliers."""

from __future__ import annotations

from dataclasses import dataclass

from gpvo.events import StereoCluster
from gpvo.front_end import FEW_INLIERS, TrackedCluster
from gpvo.tracking import TrackingReport


@dataclass(frozen=True)
class ClusterReport:
    """What became of one cluster.

    Attributes
    ----------
    start, stop
        Seconds since the recording's start.
    left_events, right_events
        Events of each camera.
    left_out
        Events that the noise filter left out: background activity, of hot pixels; both cameras.
    noise_rate
        Background activity, events per pixel and second, mean of both cameras; 0 if unknown.
    flash
        Time before the cluster that was left out because of a flash, seconds.
    between
        Events between the cluster before and this one, which were left out; both cameras.
    tracking
        What the tracker found; None if it does not say.
    observations
        Stereo observations that the tracker added since the report before.
    out_of_bounds
        Those that the filters of stereo time difference and disparity left out.
    too_short
        Tracklets that reach into the cluster and are too short in pixels or seconds.
    tracklets
        Those that pass the filters.
    inliers
        Those of them that MC-RANSAC's velocity explains.
    measurements
        Measurements given to the estimator.
    """

    start: float
    stop: float
    left_events: int
    right_events: int
    left_out: tuple[int, int]
    noise_rate: float
    flash: float
    between: int
    tracking: TrackingReport | None
    observations: int
    out_of_bounds: int
    too_short: int
    tracklets: int
    inliers: int
    measurements: int

    @property
    def events(self) -> int:
        """Events of both cameras."""
        return self.left_events + self.right_events

    @property
    def at_rest(self) -> bool:
        """Nothing moved in the cluster."""
        return self.tracking is not None and self.tracking.at_rest

    @property
    def hardly_measures(self) -> bool:
        """Something moved, and fewer than FEW_INLIERS tracklets agree on how."""
        return self.inliers < FEW_INLIERS and not self.at_rest

    @staticmethod
    def of(cluster: StereoCluster, tracked: TrackedCluster) -> ClusterReport:
        """Report a cluster that the front end processed."""
        left, right = cluster.left, cluster.right
        background, hot = (sum(pair) for pair in zip(left.left_out, right.left_out, strict=True))
        return ClusterReport(
            cluster.start,
            cluster.stop,
            left.event_count,
            right.event_count,
            (background, hot),
            0.5 * (left.noise_rate + right.noise_rate),
            cluster.flash,
            cluster.between,
            tracked.tracking,
            len(tracked.observations),
            tracked.out_of_bounds,
            tracked.too_short,
            len(tracked.later),
            int(tracked.inliers.sum()),
            len(tracked.measurements),
        )
