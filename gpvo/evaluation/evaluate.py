"""Evaluation of one estimate against the ground truth."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpvo.errors import InputError, require_choice
from gpvo.evaluation.metrics.alignment import AlignmentMethod, first_pose_alignment
from gpvo.evaluation.metrics.association import common_interval, common_part, known_ns
from gpvo.evaluation.metrics.ate_rpe import (
    TrajectoryError,
    absolute_trajectory_error,
    pose_progress,
    relative_pose_error,
)
from gpvo.evaluation.metrics.gp_interpolation import interpolate_by_gp
from gpvo.evaluation.metrics.kitti_segments import SegmentError, segment_errors
from gpvo.evaluation.metrics.paper_errors import (
    FrameTransform,
    PoseErrors,
    global_error,
    motion_integrals,
    relative_error,
)
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import seconds_text

Interpolation = Literal["linear", "gp"]

TURN = 0.02
"""Largest turn about the path by which position errors may mislead an alignment, rad."""
ATE_ALIGNMENTS: tuple[AlignmentMethod, ...] = ("se3", "sim3", "yaw", "first", "none")


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Errors of one estimate, as tables by `evaluation_tables` and as JSON by `to_json`.

    Attributes
    ----------
    name
        Name of the estimate in tables.
    estimate, ground_truth
        Poses at the same stamps; the estimate is aligned by its first pose.
    global_error, relative_error
        The paper's errors, N global and N - 1 relative ones.
    ate
        Absolute trajectory error by alignment method.
    rpe
        Relative pose error over one second and over one metre.
    segments
        Drift by segment length.
    coverage
        Fraction of the ground truth's time that the estimate covers, 0 to 1, both without gaps.
    """

    name: str
    estimate: StampedPoses
    ground_truth: StampedPoses
    global_error: PoseErrors
    relative_error: PoseErrors
    ate: dict[AlignmentMethod, TrajectoryError]
    rpe: dict[str, TrajectoryError]
    segments: list[SegmentError]
    coverage: float

    @property
    def path_length(self) -> float:
        """Path length of the ground truth, metres."""
        return motion_integrals(self.ground_truth)["translation"]

    @property
    def distances(self) -> NDArray[np.float64]:
        """(N,) distance that the ground truth has travelled at every stamp, metres."""
        return pose_progress(self.ground_truth, "metres")

    @property
    def width(self) -> float:
        """RMS distance of the true positions from the line that fits them best, metres."""
        positions = self.ground_truth.positions
        spread = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
        return float(np.linalg.norm(spread[1:]) / np.sqrt(len(positions)))

    @property
    def aligned_rotation_doubt(self) -> float:
        """Turn about the path by which errors of positions may mislead their alignment, rad."""
        return float(np.arctan2(self.ate["se3"].translation.rmse, self.width))

    @property
    def aligned_rotation_is_known(self) -> bool:
        """Whether the alignment of positions leaves no turn about a nearly straight path."""
        return self.aligned_rotation_doubt <= TURN

    @property
    def drift_percent(self) -> float:
        """Mean translation drift over the longest segments, in percent of their length."""
        return self.segments[-1].translation_percent if self.segments else float("nan")

    def to_dict(self) -> dict[str, Any]:
        """Return all numbers by name; undefined ones (percent of a path at rest) are None."""
        stamps_ns = self.estimate.stamps_ns
        return _without_nan(
            {
                "name": self.name,
                "poses": len(stamps_ns),
                "start": seconds_text(stamps_ns[0]),
                "duration_s": float(self.estimate.seconds[-1]),
                "coverage": self.coverage,
                "path_length_m": self.path_length,
                "rotation_integral_rad": self.global_error.motion["rotation"],
                "global_error": self.global_error.to_dict(),
                "relative_error": self.relative_error.to_dict(),
                "ate": {method: asdict(error) for method, error in self.ate.items()},
                "rpe": {distance: asdict(error) for distance, error in self.rpe.items()},
                "segments": [asdict(segment) for segment in self.segments],
            }
        )

    def to_json(self) -> str:
        """Return the numbers as indented JSON."""
        return json.dumps(self.to_dict(), indent=2) + "\n"


def evaluate(
    estimate: StampedPoses,
    ground_truth: StampedPoses,
    *,
    name: str = "gpvo",
    stamps_ns: ArrayLike | None = None,
    step: float = 0.01,
    aligned_at: FrameTransform = "step",
    pair: tuple[StampedPoses, StampedPoses] | None = None,
    truth_between: Interpolation = "linear",
) -> Evaluation:
    """Compare an estimate with the ground truth, both interpolated at the same stamps.

    Parameters
    ----------
    estimate, ground_truth
        T_world_cam of the same camera, each in a world frame of its own.
    name
        Name of the estimate in tables.
    stamps_ns
        Stamps at which to compare, for instance a competitor's states; those outside the common
        time, or in gaps of either, are left out. By default every `step` seconds of it.
    aligned_at
        Frame transform of the relative error, see `relative_error`.
    pair
        Associated estimated and true poses for ATE, RPE and drift, for instance associated like
        evo does; by default the compared poses.
    truth_between
        Interpolation of the ground truth: "linear" as in the paper, or "gp", the Gaussian process.

    Raises
    ------
    InputError
        If the two have fewer than two stamps in common, or an argument names no choice.
    """
    require_choice("truth_between", truth_between, Interpolation)
    if stamps_ns is None:
        stamps_ns = common_stamps(estimate, ground_truth, step)
    stamps = common_part(stamps_ns, estimate, ground_truth)
    interpolate = interpolate_by_gp if truth_between == "gp" else StampedPoses.interpolate
    truth = interpolate(ground_truth, stamps)
    sampled = estimate.interpolate(stamps)
    aligned = first_pose_alignment(sampled, truth).apply(sampled)
    pair = pair or (sampled, truth)
    return Evaluation(
        name=name,
        estimate=aligned,
        ground_truth=truth,
        global_error=global_error(aligned, truth),
        relative_error=relative_error(aligned, truth, aligned_at),
        ate={method: absolute_trajectory_error(*pair, method) for method in ATE_ALIGNMENTS},
        rpe={
            "1 s": relative_pose_error(*pair, 1.0, "seconds"),
            "1 m": relative_pose_error(*pair, 1.0, "metres"),
        },
        segments=segment_errors(*pair),
        coverage=known_ns(stamps) / known_ns(ground_truth.stamps_ns),
    )


def common_stamps(
    estimate: StampedPoses, ground_truth: StampedPoses, step: float = 0.01
) -> NDArray[np.int64]:
    """Return stamps every `step` seconds of the common time, without its end."""
    if not 1e-9 <= step <= 1e9:
        raise InputError(f"step {step}: must be seconds between two stamps, 1e-9 to 1e9")
    start, stop = common_interval(estimate, ground_truth)
    return np.arange(start, stop, round(step * 1e9), dtype=np.int64)


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_without_nan(entry) for entry in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
