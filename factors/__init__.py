"""Continuous-time stereo factors for GTSAM, exact to the microsecond."""

from factors import lie
from factors.constant_velocity import EuclideanVelocityFactor, ReprojectionVelocityFactor
from factors.interpolated_stereo import InterpolatedStereoFactor
from factors.interpolation import InterpolatedState, extrapolate, interpolate
from factors.solver import optimize
from factors.stereo import StereoCamera, StereoReprojectionFactor
from factors.structureless import StructurelessStereoFactor, TrackletFactor
from factors.wnoa import (
    WnoaPriorFactor,
    wnoa_covariance,
    wnoa_information,
    wnoa_square_root_covariance,
    wnoa_square_root_information,
)

__all__ = [
    "EuclideanVelocityFactor",
    "InterpolatedState",
    "InterpolatedStereoFactor",
    "ReprojectionVelocityFactor",
    "StereoCamera",
    "StereoReprojectionFactor",
    "StructurelessStereoFactor",
    "TrackletFactor",
    "WnoaPriorFactor",
    "extrapolate",
    "interpolate",
    "lie",
    "optimize",
    "wnoa_covariance",
    "wnoa_information",
    "wnoa_square_root_covariance",
    "wnoa_square_root_information",
]
