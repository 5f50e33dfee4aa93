"""One configuration in the order of the stages, and the YAML file that it is read from."""

from gpvo.config.automatic import for_camera, in_full_pixels, in_tracked_pixels, with_drift
from gpvo.config.presets import PRESETS
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
    "PRESETS",
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
    "for_camera",
    "in_full_pixels",
    "in_tracked_pixels",
    "load_configuration",
    "load_fields",
    "with_drift",
]
