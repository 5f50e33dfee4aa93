"""How good an estimate is: the paper's errors, evo's numbers, tables, plots and reports."""

from gpvo.evaluation.alignment import Alignment, find_alignment
from gpvo.evaluation.evaluate import Evaluation, common_stamps, evaluate
from gpvo.evaluation.paper import err, global_error, relative_error
from gpvo.evaluation.trajectory_error import (
    TrajectoryError,
    absolute_trajectory_error,
    relative_pose_error,
)

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
