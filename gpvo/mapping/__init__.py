"""The map: the landmarks that survived, with how well and when they were seen."""

from gpvo.mapping.landmark_map import LandmarkMap
from gpvo.mapping.recorder import MeasurementRecorder
from gpvo.mapping.triangulation import triangulate

__all__ = ["LandmarkMap", "MeasurementRecorder", "triangulate"]
