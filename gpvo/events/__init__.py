"""Clustering of events into surfaces of active events, section III-A.1 of the paper."""

from gpvo.events.cluster_length import ImageMotion
from gpvo.events.clustering import Clustering
from gpvo.events.clusters import ClusterEvents, StereoCluster

__all__ = ["ClusterEvents", "Clustering", "ImageMotion", "StereoCluster"]
