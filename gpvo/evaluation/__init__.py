"""Evaluation of estimates: the paper's errors, ATE and RPE like evo's, tables, plots, reports."""

from gpvo.evaluation.evaluate import Evaluation, common_stamps, evaluate
from gpvo.evaluation.metrics.alignment import Alignment, find_alignment
from gpvo.evaluation.metrics.ate_rpe import (
    TrajectoryError,
    absolute_trajectory_error,
    relative_pose_error,
)
from gpvo.evaluation.metrics.paper_errors import err, global_error, relative_error

__all__ = [
    "Alignment",
    "Evaluation",
    "TrajectoryError",
    "absolute_trajectory_error",
    "common_stamps",
    "err",
    "evaluate",
    "find_alignment",
    "global_error",
    "relative_error",
    "relative_pose_error",
]
