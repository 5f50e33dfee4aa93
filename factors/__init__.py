"""Continuous-time stereo factors for GTSAM, exact to the microsecond."""

from factors.interpolated_stereo import InterpolatedStereoFactor
from factors.interpolation import InterpolatedState, extrapolate, interpolate
from factors.stereo import StereoCamera, StereoReprojectionFactor
from factors.wnoa import (
    WnoaPriorFactor,
    wnoa_covariance,
    wnoa_information,
    wnoa_square_root_information,
)

__all__ = [
    "InterpolatedState",
    "InterpolatedStereoFactor",
    "StereoCamera",
    "StereoReprojectionFactor",
    "WnoaPriorFactor",
    "extrapolate",
    "interpolate",
    "wnoa_covariance",
    "wnoa_information",
    "wnoa_square_root_information",
]
