"""gpvo: continuous-time visual odometry for stereo event cameras."""

from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.odometry import Odometry
from gpvo.recordings import Recording, open_recording
from gpvo.trajectory import Trajectory

__all__ = [
    "Configuration",
    "InputError",
    "Odometry",
    "Recording",
    "Trajectory",
    "open_recording",
]
