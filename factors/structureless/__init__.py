"""Factors of landmarks that are eliminated: many measurements, no landmark in the graph."""

from factors.structureless.multi_landmark import StructurelessStereoFactor
from factors.structureless.tracklet import TrackletFactor

__all__ = [
    "StructurelessStereoFactor",
    "TrackletFactor",
]
