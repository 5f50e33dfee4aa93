"""gpvo: continuous-time visual odometry for stereo event cameras."""

from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.estimator import FixedLagSmoother, InitialState
from gpvo.live import LiveOdometry
from gpvo.odometry import Odometry
from gpvo.recordings import Recording, open_recording
from gpvo.tracking import Measurements
from gpvo.trajectory import MotionEstimate, Trajectory

__all__ = [
    "Configuration",
    "FixedLagSmoother",
    "InitialState",
    "InputError",
    "LiveOdometry",
    "Measurements",
    "MotionEstimate",
    "Odometry",
    "Recording",
    "Trajectory",
    "open_recording",
]
