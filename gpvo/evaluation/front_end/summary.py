"""The numbers of an inspection: medians over clusters, errors pooled over tracklets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpvo.evaluation.front_end.inspect import SLOPE_AGREEMENT, InspectedCluster, JudgedTracklets

Array = NDArray[np.float64]
Numbers = dict[str, float]


def summarize(clusters: Sequence[InspectedCluster]) -> dict[str, Numbers]:
    """Compute the numbers by stage and name; NaN where there is nothing to count."""
    tracklets = JudgedTracklets.concatenate(cluster.tracklets for cluster in clusters)
    return {
        "clusters": _cluster_numbers(clusters),
        "tracklets": _tracklet_numbers(clusters, tracklets),
        "flow": flow_slopes(tracklets),
        "inlier errors": _inlier_errors(tracklets),
        "MC-RANSAC": _ransac_numbers(clusters, tracklets),
    }


def _cluster_numbers(clusters: Sequence[InspectedCluster]) -> Numbers:
    return {
        "clusters": len(clusters),
        "seconds_median": _median([c.stop - c.start for c in clusters]),
        "events_median": _median([c.events for c in clusters]),
        "features_median": _median([c.features for c in clusters[1:]]),
        "quads_median": _median([c.quads for c in clusters[1:]]),
    }


def _tracklet_numbers(clusters: Sequence[InspectedCluster], pool: JudgedTracklets) -> Numbers:
    length = np.linalg.norm(pool.measured_flow, axis=1)
    judged = np.isfinite(pool.distance)
    return {
        "per_cluster_median": _median([len(c.tracklets) for c in clusters]),
        "agreeing_per_cluster_median": _median([c.tracklets.agree.sum() for c in clusters]),
        "length_px_median": _median(length),
        "duration_s_median": _median(pool.duration),
        "agreeing_share": _mean(pool.agree[judged]),
    }


def flow_slopes(pool: JudgedTracklets) -> Numbers:
    """Compute the slope of measured on true flow; 1 if tracks neither lag nor lead."""
    near = pool.distance <= SLOPE_AGREEMENT
    measured, true = pool.measured_flow[near], pool.true_flow[near]
    across, whole = (measured * true).sum(axis=0), (true**2).sum(axis=0)
    return {
        "slope_u": _ratio(across[0], whole[0]),
        "slope_v": _ratio(across[1], whole[1]),
        "slope": _ratio(across.sum(), whole.sum()),
    }


def _inlier_errors(pool: JudgedTracklets) -> Numbers:
    inliers = pool.accepted & pool.agree
    time_error = pool.time_error[inliers & np.isfinite(pool.time_error)] * 1e6
    return {
        "left_rms_px": _rms(pool.error[inliers, :2].ravel()),
        "disparity_rms_px": _rms(pool.disparity_error[inliers]),
        "disparity_bias_px": _mean(pool.disparity_error[inliers]),
        "time_median_abs_us": _median(np.abs(time_error)),
        "time_bias_us": _median(time_error),
    }


def _ransac_numbers(clusters: Sequence[InspectedCluster], pool: JudgedTracklets) -> Numbers:
    judged = np.isfinite(pool.distance)
    accepted, agree = pool.accepted & judged, pool.agree
    numbers = {
        "inliers_median": _median([c.tracklets.accepted.sum() for c in clusters]),
        "true_inliers_median": _median(
            [(c.tracklets.accepted & c.tracklets.agree).sum() for c in clusters]
        ),
        "clusters_without_inliers": sum(not c.tracklets.accepted.any() for c in clusters),
        "precision": _ratio((accepted & agree).sum(), accepted.sum()),
        "recall": _ratio((accepted & agree).sum(), agree.sum()),
    }
    for name in ("fast", "iterative"):
        error = velocity_errors(clusters, name)
        error = error[np.isfinite(error).all(axis=1)]
        for part, unit, norm in (
            ("angular", "rad_s", np.linalg.norm(error[:, :3], axis=1)),
            ("linear", "m_s", np.linalg.norm(error[:, 3:], axis=1)),
        ):
            numbers[f"{name}_{part}_rms_{unit}"] = _rms(norm)
            numbers[f"{name}_{part}_median_{unit}"] = _median(norm)
    return numbers


def velocity_errors(clusters: Sequence[InspectedCluster], version: str) -> Array:
    """Return estimated minus true twists (C, 6); `version` is "fast" or "iterative"."""
    found = np.array([getattr(cluster, f"{version}_twist") for cluster in clusters])
    return found - np.array([cluster.true_twist for cluster in clusters])


def _median(values: Sequence[float] | NDArray) -> float:
    return float(np.median(values)) if len(values) else np.nan


def _mean(values: NDArray) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def _rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else np.nan


def _ratio(part: float, whole: float) -> float:
    return float(part / whole) if whole else np.nan
