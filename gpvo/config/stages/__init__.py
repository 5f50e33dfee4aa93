"""Configuration of every stage; `preset: paper` has the paper's values."""

from gpvo.config.stages.clustering import ClusteringConfig
from gpvo.config.stages.configuration import Configuration
from gpvo.config.stages.estimator import EstimatorConfig, NoiseConfig
from gpvo.config.stages.klt import LARGEST_PATCH, KltConfig
from gpvo.config.stages.mc_ransac import McRansacConfig
from gpvo.config.stages.stage import StageConfig
from gpvo.config.stages.tracking import CompensationConfig, TrackingConfig
from gpvo.config.stages.tracklets import TrackletConfig
from gpvo.config.stages.viso2 import FeatureConfig, Viso2Config

__all__ = [
    "LARGEST_PATCH",
    "ClusteringConfig",
    "CompensationConfig",
    "Configuration",
    "EstimatorConfig",
    "FeatureConfig",
    "KltConfig",
    "McRansacConfig",
    "NoiseConfig",
    "StageConfig",
    "TrackingConfig",
    "TrackletConfig",
    "Viso2Config",
]
