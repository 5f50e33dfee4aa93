"""The continuous trajectory, section III-C.2 of the paper, and poses in files."""

from gpvo.trajectory.covariance_knots import CovarianceKnots
from gpvo.trajectory.motion_estimate import MotionEstimate
from gpvo.trajectory.stamped_poses import StampedPoses
from gpvo.trajectory.states import States
from gpvo.trajectory.trajectory import Trajectory
from gpvo.trajectory.tum import read_tum, write_tum

__all__ = [
    "CovarianceKnots",
    "MotionEstimate",
    "StampedPoses",
    "States",
    "Trajectory",
    "read_tum",
    "write_tum",
]
