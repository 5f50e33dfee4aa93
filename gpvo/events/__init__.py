"""Clustering of events into surfaces of active events, section III-A.1 of the paper."""

from gpvo.events.clustering import (
    ClusterEvents,
    Clustering,
    RectifiedEvents,
    StereoCluster,
    cluster_events,
)

__all__ = [
    "ClusterEvents",
    "Clustering",
    "RectifiedEvents",
    "StereoCluster",
    "cluster_events",
]
