"""The front end, as the paper's figure: a cluster in, the measurements of inlier tracklets out."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.config import Configuration
from gpvo.events import StereoCluster
from gpvo.mc_ransac import VelocityFit, mc_ransac, segments_between
from gpvo.recordings import StereoRig
from gpvo.tracking import Measurements, Observations, Tracker, Tracklets, make_tracker


@dataclass(frozen=True, eq=False)
class TrackedCluster:
    """What the front end makes of one cluster.

    Attributes
    ----------
    observations
        Stereo observations that the tracker added.
    earlier, later
        The ends of the N tracklets that reach into the cluster and pass the filters.
    velocity_estimate
        MC-RANSAC's velocity; None if there is none.
    inliers
        (N,) bool, which tracklets the velocity explains.
    measurements
        Those of the inliers that were not given before.
    """

    observations: Observations
    earlier: Measurements
    later: Measurements
    velocity_estimate: VelocityFit | None
    inliers: NDArray[np.bool_]
    measurements: Measurements


class FrontEnd:
    """The stages before the estimator.

    `tracker` takes the place of the configuration's; `stage`, if given, is entered around every
    stage with the stage's name, to time it.

    Attributes
    ----------
    camera
        The rectified stereo camera.
    rng
        Draws MC-RANSAC's samples.
    """

    def __init__(
        self,
        rig: StereoRig,
        configuration: Configuration,
        tracker: Tracker | None = None,
        stage: Callable[[str], AbstractContextManager[Any]] = nullcontext,
    ) -> None:
        self.camera = StereoCamera(
            rig.focal_length, rig.focal_length, *rig.principal_point, rig.baseline
        )
        self.rng = np.random.default_rng(configuration.seed)
        self._config = configuration.mc_ransac
        self._information = np.diag(configuration.noise.measurement_information)
        self._tracker = make_tracker(configuration.tracking) if tracker is None else tracker
        self._tracklets = Tracklets(configuration.tracklets)
        self._stage = stage

    def process(self, cluster: StereoCluster) -> TrackedCluster:
        """Track landmarks into one more cluster, the next in time, and keep the inliers."""
        with self._stage("tracking"):
            observations = self._tracker.track(cluster)
        with self._stage("tracklets"):
            self._tracklets.add(cluster, observations)
            earlier, later = self._tracklets.pairs(self._config.span)
        with self._stage("outlier rejection"):
            segments = segments_between(earlier, later)
            estimate = mc_ransac(segments, self.camera, self._information, self._config, self.rng)
            inliers = np.zeros(len(later), bool) if estimate is None else estimate.inliers
            self._tracklets.reject(later.landmark[~inliers])
            measurements = self._tracklets.take(later.landmark[inliers])
        return TrackedCluster(observations, earlier, later, estimate, inliers, measurements)
