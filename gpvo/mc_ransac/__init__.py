"""Outlier rejection by one constant velocity, section III-B of the paper."""

from gpvo.mc_ransac.fast import fast_mc_ransac
from gpvo.mc_ransac.fusion import fused_velocity, trusted_velocity
from gpvo.mc_ransac.iterative import VelocityFit, iterative_mc_ransac
from gpvo.mc_ransac.mc_ransac import mc_ransac
from gpvo.mc_ransac.segments import Segments, segments_between
from gpvo.mc_ransac.track_record import TrackRecord

__all__ = [
    "Segments",
    "TrackRecord",
    "VelocityFit",
    "fast_mc_ransac",
    "fused_velocity",
    "iterative_mc_ransac",
    "mc_ransac",
    "segments_between",
    "trusted_velocity",
]
