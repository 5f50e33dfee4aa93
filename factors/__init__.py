"""Continuous-time stereo factors for GTSAM, exact to the microsecond."""

from factors import lie
from factors.constant_velocity import EuclideanVelocityFactor, ReprojectionVelocityFactor
from factors.factor import Factor, check_values, original
from factors.gaussian_process import Derivatives, GaussianProcess
from factors.incremental import Incremental, fixed_lag_smoother, isam2, isam2_parameters
from factors.inertial import GyroFactor, ImuFactor
from factors.inner_factor import ErrorFunction
from factors.interpolated import InterpolatedFactor
from factors.interpolated_stereo import InterpolatedStereoFactor
from factors.interpolation import InterpolatedState, extrapolate, interpolate
from factors.linear_states import LinearStatesFactor
from factors.motion_priors import (
    WnoaPriorFactor,
    WnoaPriorFactorPose2,
    WnoaPriorFactorRot3,
    WnoaPriorFactorVector,
    WnojPriorFactor,
    WnojPriorFactorPose2,
    WnojPriorFactorRot3,
    WnojPriorFactorVector,
)
from factors.points import PointToPlaneFactor, PointToPointFactor
from factors.saving import from_dict, to_dict
from factors.solver import Iteration, gauss_newton_parameters, optimize
from factors.stereo import StereoCamera, StereoReprojectionFactor
from factors.structureless import (
    LandmarkPrior,
    Marginal,
    StatesBetween,
    StructurelessStereoFactor,
    marginalize,
)
from factors.wnoa import (
    prior_covariance,
    prior_square_root_information,
    wnoa_covariance,
    wnoa_information,
    wnoa_square_root_covariance,
    wnoa_square_root_information,
)

__all__ = [
    "Derivatives",
    "ErrorFunction",
    "EuclideanVelocityFactor",
    "Factor",
    "GaussianProcess",
    "GyroFactor",
    "ImuFactor",
    "Incremental",
    "InterpolatedFactor",
    "InterpolatedState",
    "InterpolatedStereoFactor",
    "Iteration",
    "LandmarkPrior",
    "LinearStatesFactor",
    "Marginal",
    "PointToPlaneFactor",
    "PointToPointFactor",
    "ReprojectionVelocityFactor",
    "StatesBetween",
    "StereoCamera",
    "StereoReprojectionFactor",
    "StructurelessStereoFactor",
    "WnoaPriorFactor",
    "WnoaPriorFactorPose2",
    "WnoaPriorFactorRot3",
    "WnoaPriorFactorVector",
    "WnojPriorFactor",
    "WnojPriorFactorPose2",
    "WnojPriorFactorRot3",
    "WnojPriorFactorVector",
    "check_values",
    "extrapolate",
    "fixed_lag_smoother",
    "from_dict",
    "gauss_newton_parameters",
    "interpolate",
    "isam2",
    "isam2_parameters",
    "lie",
    "marginalize",
    "optimize",
    "original",
    "prior_covariance",
    "prior_square_root_information",
    "to_dict",
    "wnoa_covariance",
    "wnoa_information",
    "wnoa_square_root_covariance",
    "wnoa_square_root_information",
]
