"""The paper's thesis as an experiment: does it pay to keep every measurement's own time?

Run as `python -m benchmarks.native_times`; `--recording FILE --calibration FILE --ground-truth
FILE` adds a recording of yours to the simulated ones. The same image points are given

- times: those of their patches, of their nearest events (the paper), or grouped, the cluster's
  middle for all; in the last row the points are those of motion-compensated images, the default;
- an outlier rejection: MC-RANSAC, or RANSAC of one transform between two clusters (OpenCV);
- an estimator: the WNOA Gaussian process, or discrete poses, without motion prior and joined by
  straight lines.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.known_motion import KnownRecording, known_recordings, parse_options
from benchmarks.mc_ransac import frame_based_inliers
from factors.stereo import StereoCamera
from gpvo.commands.result import STEP, evaluate_trajectory
from gpvo.config import Configuration, McRansacConfig
from gpvo.estimator import make_estimator
from gpvo.evaluation import Evaluation, evaluate
from gpvo.events import ClusterEvents, Clustering, StereoCluster
from gpvo.mc_ransac import Segments, VelocityFit, iterative_mc_ransac, mc_ransac, segments_between
from gpvo.recordings import Recording
from gpvo.simulation import SimulationConfig
from gpvo.tracking import MultiResolutionTracker, Observations, Tracklets
from gpvo.trajectory import StampedPoses, Trajectory

SIMULATIONS = {
    motion: SimulationConfig(seed=11, motion=motion, noise_rate=0.5)
    for motion in ("fast", "rotation", "back_and_forth")
}
INFORMATION = (10.0, 10.0, 10.0)
"""Inverse square of the 0.3 pixels that `gpvo inspect` finds."""
BASE = {
    "clustering": {"max_events": 20_000},  # the same clusters, whatever the variants make of them
    "estimator": {"state_interval": 0.01},
    "noise": {"measurement_information": INFORMATION},
    "tracking": {"image": "binary", "klt": {"max_features": 80}},
}
NO_PRIOR = tuple(1e6 * value for value in Configuration().noise.acceleration_psd)

Tracked = list[tuple[StereoCluster, Observations]]


@dataclass(frozen=True)
class Variant:
    """One way from image points to poses."""

    times: str  # "patch", "nearest", "grouped" or "compensated"
    rejection: str  # "MC-RANSAC" or "frame-based"
    estimator: str  # "WNOA" or "discrete"

    @property
    def configuration(self) -> Configuration:
        """That of the whole, as far as it is a matter of configuration."""
        config = Configuration.model_validate(BASE)
        radius = 0.0 if self.times == "nearest" else config.tracklets.time_radius
        psd = NO_PRIOR if self.estimator == "discrete" else config.noise.acceleration_psd
        return config.model_copy(
            update={
                "tracklets": config.tracklets.model_copy(update={"time_radius": radius}),
                "noise": config.noise.model_copy(update={"acceleration_psd": psd}),
            }
        )


VARIANTS = (
    Variant("patch", "MC-RANSAC", "WNOA"),
    Variant("nearest", "MC-RANSAC", "WNOA"),
    Variant("grouped", "MC-RANSAC", "WNOA"),
    Variant("patch", "frame-based", "WNOA"),
    Variant("grouped", "frame-based", "WNOA"),
    Variant("grouped", "MC-RANSAC", "discrete"),
    Variant("grouped", "frame-based", "discrete"),
    Variant("compensated", "MC-RANSAC", "WNOA"),
)


def track(known: KnownRecording, image: str) -> Tracked:
    """Clusters and what the tracker sees in their images, once for all variants."""
    config = Configuration.model_validate(BASE)
    tracking = config.tracking.model_copy(update={"image": image})
    tracker = MultiResolutionTracker(tracking, known.recording.rig.stereo_camera)
    batches = known.recording.event_batches(known.start, known.start + known.duration)
    clusters = Clustering(known.recording.rig, config.clustering).clusters(batches)
    return [(cluster, tracker.track(cluster)) for cluster in clusters]


def grouped(cluster: StereoCluster) -> StereoCluster:
    """The cluster with all its events at its middle."""
    middle = cluster.middle

    def flat(image: ClusterEvents) -> ClusterEvents:
        events = replace(image.events, t=np.full(image.event_count, middle))
        return replace(image, parts=(events,))

    return replace(cluster, left=flat(cluster.left), right=flat(cluster.right))


def run(recording: Recording, tracked: Tracked, variant: Variant) -> tuple[Trajectory, int]:
    """The trajectory and the median number of inliers."""
    config, camera = variant.configuration, recording.rig.stereo_camera
    tracklets = Tracklets(config.tracklets, config.tracking.earlier_frames)
    estimator = make_estimator(camera, config.noise, config.estimator)
    rng, counts = np.random.default_rng(config.seed), []
    for cluster, observations in _timed(tracked, variant):
        tracklets.add(cluster, observations)
        earlier, later = tracklets.pairs(config.mc_ransac.span)
        landmarks = later.landmark
        estimate = fitted(segments_between(earlier, later), camera, config, variant.rejection, rng)
        inliers = landmarks[estimate.inliers] if estimate is not None else landmarks[:0]
        tracklets.reject(np.setdiff1d(landmarks, inliers))
        estimator.update(cluster.stop, tracklets.take(inliers), estimate)
        counts.append(len(inliers))
    trajectory = estimator.trajectory(recording.start_ns)
    assert trajectory is not None, "nothing could be tracked"
    return trajectory, int(np.median(counts))


def _timed(tracked: Tracked, variant: Variant) -> Iterator[tuple[StereoCluster, Observations]]:
    for cluster, observations in tracked:
        yield (grouped(cluster) if variant.times == "grouped" else cluster), observations


def fitted(
    segments: Segments,
    camera: StereoCamera,
    config: Configuration,
    rejection: str,
    rng: np.random.Generator,
) -> VelocityFit | None:
    """Inliers by either rejection, and their velocity, with which the estimator starts."""
    information = np.diag(config.noise.measurement_information)
    if rejection == "MC-RANSAC":
        return mc_ransac(segments, camera, information, config.mc_ransac, rng)
    inliers = one_transform_inliers(segments, camera, config.mc_ransac)
    if inliers.sum() < config.mc_ransac.sample_size:
        return None
    fit = iterative_mc_ransac(segments, camera, information, np.zeros(6), inliers, config.mc_ransac)
    return None if fit is None else replace(fit, inliers=inliers)


def one_transform_inliers(
    segments: Segments, camera: StereoCamera, config: McRansacConfig
) -> NDArray[np.bool_]:
    """Frame-based inliers of segments that span equally many clusters, each span by itself.

    Grouped segments of one span have one duration; native ones are counted to the nearest one.
    """
    inliers = np.zeros(len(segments), bool)
    if len(segments) == 0:
        return inliers
    spans = np.rint(segments.dt / max(segments.dt.max() / config.span, 1e-6)).astype(int)
    for span in np.unique(spans):
        chosen = np.flatnonzero(spans == span)
        if len(chosen) >= 6:
            inliers[chosen] = frame_based_inliers(segments[chosen], config, camera)
    return inliers


def errors(variant: Variant, trajectory: Trajectory, truth: StampedPoses) -> Evaluation:
    """Asked every 10 ms, or, of discrete poses, interpolated linearly."""
    if variant.estimator == "WNOA":
        return evaluate_trajectory(trajectory, truth)
    poses = trajectory.stamped_poses(trajectory.t)
    first, last = (
        max(poses.stamps_ns[0], truth.stamps_ns[0]),
        min(poses.stamps_ns[-1], truth.stamps_ns[-1]),
    )
    stamps = np.arange(first, last, round(STEP * 1e9), dtype=np.int64)
    return evaluate(poses.interpolate(stamps), truth, stamps_ns=stamps)


def table(known: KnownRecording) -> Table:
    """All variants on one recording."""
    tracked = {image: track(known, image) for image in ("binary", "motion_compensated")}
    rows = Table("times", "rejection", "estimator", "inliers", "relative", "global [m]", "final")
    rows.title = f"{known.name}, {known.duration:g} s"
    for variant in VARIANTS:
        image = "motion_compensated" if variant.times == "compensated" else "binary"
        trajectory, inliers = run(known.recording, tracked[image], variant)
        rows.add_row(
            variant.times,
            variant.rejection,
            variant.estimator,
            str(inliers),
            *_numbers(errors(variant, trajectory, known.ground_truth)),
        )
    return rows


def _numbers(evaluation: Evaluation) -> Sequence[str]:
    relative = evaluation.relative_error.norms["se3"]
    drift, path = evaluation.global_error.norms["translation"], evaluation.distances[-1]
    return (
        f"{np.sqrt(np.mean(relative**2)):.2e}",
        f"{np.sqrt(np.mean(drift**2)):.4f}",
        f"{100 * drift[-1] / path:.2f} %" if path > 0 else "no path",
    )


def main() -> None:
    """Print a table for every motion."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options = parse_options(parser)
    cv2.setNumThreads(1)
    console = Console()
    for known in known_recordings(options, SIMULATIONS):
        console.print(table(known))


if __name__ == "__main__":
    main()
