"""Values of the configuration that follow from the camera."""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt
from typing import Any, TypeVar

from gpvo.config.stages import (
    LARGEST_PATCH,
    Configuration,
    KltConfig,
    NoiseConfig,
    StageConfig,
    TrackingConfig,
)

Stage = TypeVar("Stage", bound=StageConfig)

LARGE = 640 * 480
"""Pixels up to which a sensor is tracked at its full resolution."""
PATCH_SHARE = 1.8
"""Side of a patch over the square root of the focal length, both in tracked pixels."""
DRIFT_SHARE, DRIFT_POWER = 1 / 28, 0.6
"""`track_drift` is a share of this power of the focal length, both in tracked pixels."""

Powers = Mapping[str, float]
"""Fields of a stage, and the powers of a unit that they have."""

LENGTHS: dict[str, Powers] = {
    "tracklets": {"time_radius": 1, "min_disparity": 1, "min_length": 1},
    "mc_ransac": {"pixel_threshold": 1, "disparity_tolerance": 1},
    "noise": {
        "measurement_information": -2,
        "track_drift": 1,
    },
}
"""Fields in tracked pixels and the powers of a pixel that they have."""


def for_camera(
    configuration: Configuration, resolution: tuple[int, int], focal_length: float
) -> Configuration:
    """Return the configuration with what suits a sensor (width, height) and its focal length.

    Both are in pixels of the sensor.
    """
    tracking = _at_resolution(configuration.tracking, resolution)
    focal_length /= tracking.pixel
    klt = _with_patch(tracking.klt, focal_length)
    tracking = tracking.model_copy(update={"klt": klt})
    noise = with_drift(configuration.noise, focal_length)
    return configuration.model_copy(update={"tracking": tracking, "noise": noise})


def _at_resolution(tracking: TrackingConfig, resolution: tuple[int, int]) -> TrackingConfig:
    """Choose the resolution that is tracked.

    Features of event images are edges, and what is tracked must hold some of them: the same patch
    holds fewer on a larger sensor, which also sees finer texture than a cluster can show. Sensors
    of more than LARGE pixels are therefore tracked at half their resolution.
    """
    if tracking.resolutions is not None:
        return tracking
    side = 1 if resolution[0] * resolution[1] <= LARGE else 2
    return tracking.model_copy(update={"resolutions": (side,)})


def _with_patch(klt: KltConfig, focal_length: float) -> KltConfig:
    """Choose the side of the patches for a focal length in tracked pixels.

    The variance of a match is as 1 / side^2. A patch that holds the border of a thing sees two
    depths, and its match is between them: as many do as it is wide in angle, and by as much, so
    that their mean square is as (side / focal length)^2. The sum of both is least for a side as
    the square root of the focal length.
    """
    if klt.patch_size is not None:
        return klt
    side = min(LARGEST_PATCH, 2 * round((PATCH_SHARE * sqrt(focal_length) - 1) / 2) + 1)
    return klt.model_copy(update={"patch_size": max(side, 5)})


def with_drift(noise: NoiseConfig, focal_length: float) -> NoiseConfig:
    """Choose how far tracks move on their landmarks, for a focal length in tracked pixels.

    By a part of a patch, which is larger where the focal length is. On simulated recordings of 2 to
    30 s the NEES of poses is nearest to one with 0.74 pixels at a focal length of 157, 0.9 at 226,
    1.35 at 420 and 1.7 at 640.
    """
    if noise.track_drift is not None:
        return noise
    return noise.model_copy(update={"track_drift": DRIFT_SHARE * focal_length**DRIFT_POWER})


def in_full_pixels(configuration: Configuration) -> Configuration:
    """Return the configuration with lengths in pixels of the sensor instead of tracked ones."""
    side = configuration.tracking.pixel
    stages = {
        name: scaled(getattr(configuration, name), powers, side) for name, powers in LENGTHS.items()
    }
    return configuration.model_copy(update=stages)


def in_tracked_pixels(noise: NoiseConfig, configuration: Configuration) -> NoiseConfig:
    """Return noise in pixels of the sensor in tracked ones."""
    return scaled(noise, LENGTHS["noise"], 1 / configuration.tracking.pixel)


def scaled(stage: Stage, powers: Powers, unit: float) -> Stage:
    """Return a stage's fields in units of which `unit` are a present one."""
    values: dict[str, Any] = {}
    for name, power in powers.items():
        value = getattr(stage, name)
        if value is not None:
            many = isinstance(value, tuple)
            values[name] = tuple(v * unit**power for v in value) if many else value * unit**power
    return stage.model_copy(update=values)
