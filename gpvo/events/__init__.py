"""Clustering of events into surfaces of active events, section III-A.1 of the paper."""

from gpvo.events.cluster_length import ImageMotion
from gpvo.events.clustering import (
    ClusterEvents,
    Clustering,
    StereoCluster,
    cluster_events,
)

__all__ = [
    "ClusterEvents",
    "Clustering",
    "ImageMotion",
    "StereoCluster",
    "cluster_events",
]
