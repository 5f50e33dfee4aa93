"""Factors of landmarks that are eliminated: many measurements, no landmark in the graph."""

from factors.structureless.landmark_prior import LandmarkPrior
from factors.structureless.marginalization import Marginal, marginalize
from factors.structureless.multi_landmark import StructurelessStereoFactor
from factors.structureless.states_between import StatesBetween

__all__ = [
    "LandmarkPrior",
    "Marginal",
    "StatesBetween",
    "StructurelessStereoFactor",
    "marginalize",
]
