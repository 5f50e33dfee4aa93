"""One configuration in the order of the stages, and the YAML file that it is read from."""

from gpvo.config.stages import (
    ClusteringConfig,
    Configuration,
    EstimatorConfig,
    FeatureConfig,
    McRansacConfig,
    NoiseConfig,
    StageConfig,
    TrackingConfig,
    TrackletConfig,
    Viso2Config,
)
from gpvo.config.yaml_file import configuration_text, load_configuration, load_fields

__all__ = [
    "ClusteringConfig",
    "Configuration",
    "EstimatorConfig",
    "FeatureConfig",
    "McRansacConfig",
    "NoiseConfig",
    "StageConfig",
    "TrackingConfig",
    "TrackletConfig",
    "Viso2Config",
    "configuration_text",
    "load_configuration",
    "load_fields",
]
