"""All stages together."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, model_validator

from gpvo.config.presets import PRESETS, with_preset
from gpvo.config.stages.clustering import ClusteringConfig
from gpvo.config.stages.estimator import EstimatorConfig, NoiseConfig
from gpvo.config.stages.mc_ransac import McRansacConfig
from gpvo.config.stages.stage import StageConfig
from gpvo.config.stages.tracking import TrackingConfig
from gpvo.config.stages.tracklets import TrackletConfig


class Configuration(StageConfig):
    """All stages, in the order of the flow."""

    preset: Literal["auto", "paper"] = Field(
        default="auto",
        description="Values of what is not given: auto for any camera and light, paper for those "
        "and the ways of the paper.",
    )
    clustering: ClusteringConfig = ClusteringConfig()
    tracking: TrackingConfig = TrackingConfig()
    tracklets: TrackletConfig = TrackletConfig()
    mc_ransac: McRansacConfig = McRansacConfig()
    noise: NoiseConfig = NoiseConfig()
    estimator: EstimatorConfig = EstimatorConfig()
    seed: int = Field(default=0, ge=0, description="Seed of all random choices.")

    @model_validator(mode="before")
    @classmethod
    def _fill_in_preset(cls, values: Any) -> Any:
        """Add the preset's values, where none are given."""
        preset = values.get("preset", "auto") if isinstance(values, dict) else None
        if not isinstance(preset, str) or preset not in PRESETS:
            return values
        given = {
            name: value.model_dump(exclude_unset=True) if isinstance(value, StageConfig) else value
            for name, value in values.items()
        }
        return with_preset(given, PRESETS[preset])
