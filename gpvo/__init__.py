"""gpvo: continuous-time visual odometry for stereo event cameras.

Names are imported when they are asked for, so that the command line starts at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
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

_PLACES = {
    "Configuration": "config",
    "FixedLagSmoother": "estimator",
    "InitialState": "estimator",
    "InputError": "errors",
    "LiveOdometry": "live",
    "Measurements": "tracking",
    "MotionEstimate": "trajectory",
    "Odometry": "odometry",
    "Recording": "recordings",
    "Trajectory": "trajectory",
    "open_recording": "recordings",
}


def __getattr__(name: str) -> object:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"gpvo.{_PLACES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
