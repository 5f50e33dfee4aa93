"""Values of the configuration that follow from the camera."""

from __future__ import annotations

from typing import Any, TypeVar

from gpvo.config.stages import Configuration, NoiseConfig, StageConfig

Stage = TypeVar("Stage", bound=StageConfig)

LARGE = 640 * 480
"""Pixels up to which a sensor is tracked at its full resolution."""

LENGTHS: dict[str, dict[str, int]] = {
    "tracklets": {"time_radius": 1, "min_disparity": 1, "min_length": 1},
    "mc_ransac": {"pixel_threshold": 1},
    "noise": {"measurement_information": -2, "track_drift": 1, "known_again": 1},
}
"""Fields in tracked pixels and the powers of a pixel that they have."""


def for_camera(configuration: Configuration, resolution: tuple[int, int]) -> Configuration:
    """Return the configuration with what suits a sensor (width, height).

    Features of event images are edges, and what is tracked must hold some of them: the same patch
    holds fewer on a larger sensor, which also sees finer texture than a cluster can show. Sensors
    of more than LARGE pixels are therefore tracked at half their resolution.
    """
    tracking = configuration.tracking
    if tracking.resolutions is not None:
        return configuration
    side = 1 if resolution[0] * resolution[1] <= LARGE else 2
    tracking = tracking.model_copy(update={"resolutions": (side,)})
    return configuration.model_copy(update={"tracking": tracking})


def in_full_pixels(configuration: Configuration) -> Configuration:
    """Return the configuration with lengths in pixels of the sensor instead of tracked ones."""
    side = configuration.tracking.pixel
    stages = {
        name: _scaled(getattr(configuration, name), powers, side)
        for name, powers in LENGTHS.items()
    }
    return configuration.model_copy(update=stages)


def in_tracked_pixels(noise: NoiseConfig, configuration: Configuration) -> NoiseConfig:
    """Return noise in pixels of the sensor in tracked ones."""
    return _scaled(noise, LENGTHS["noise"], 1 / configuration.tracking.pixel)


def _scaled(stage: Stage, powers: dict[str, int], side: float) -> Stage:
    """Return a stage's fields in units of which `side` are a present one."""
    values: dict[str, Any] = {}
    for name, power in powers.items():
        value = getattr(stage, name)
        many = isinstance(value, tuple)
        values[name] = tuple(v * side**power for v in value) if many else value * side**power
    return stage.model_copy(update=values)
