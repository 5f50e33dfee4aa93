"""Presets: values of many fields under one name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

AUTO: dict[str, Any] = {
    "noise": {
        "measurement_information": [4.0, 4.0, 7.0],
        "track_drift": None,
        "motion_memory": 0.5,
        "acceleration_memory": 6.0,
        "measurement_memory": 5.0,
        "velocity_share": 0.25,
    },
    "estimator": {"bridge": 0.75, "loss": "huber", "loss_scale": 0.7},
}
"""Any camera and light: noise is learned while the odometry runs.

A third of the information that single measurements have, as those of a track err alike. Their
errors have long tails: the largest per cent is beyond five deviations of most.
"""

PAPER: dict[str, Any] = {
    "clustering": {
        "window": 0.1,
        "max_events": 20_000,
        "spacing": 1.0,
        "background_filter": 0.0,
        "hot_pixel_ratio": 0.0,
        "skip_flashes": False,
    },
    "tracking": {
        "tracker": "viso2",
        "resolutions": [1, 2],
        "image": "binary",
        "klt": {
            "crowding": None,
            "candidates": 1.0,
            "anchor_correlation": 1.0,
            "slopes": False,
            "deviations": False,
            "lost_landmarks": 0,
        },
        "compensation": {
            "lag_share": 0.0,
            "little_motion": 0.0,
            "sharpest": False,
            "density": None,
        },
    },
    "tracklets": {
        "time_radius": 0.0,
        "max_stereo_time_difference": 0.020,
        "min_disparity": 2.0,
        "min_length": 2.0,
        "min_duration": 0.040,
    },
    "mc_ransac": {
        "iterations": 10_000,
        "relative_threshold": 0.05,
        "pixel_threshold": 0.0,
        "disparity_tolerance": 0.0,
        "confidence": 1.0,
        "track_record": False,
        "refinements": 1,
    },
    "noise": {
        "acceleration_psd": [1 / 500] * 3 + [1 / 50] * 3,
        "measurement_information": [0.5, 0.5, 0.1],
        "track_drift": 0.0,
        "motion_memory": 0.0,
        "acceleration_memory": 0.0,
        "measurement_memory": 0.0,
        "velocity_share": 1.0,
    },
    "estimator": {
        "method": "batch",
        "interval": 0.0,
        "start_landmarks": 0,
        "window": 5,
        "lost_landmarks": 0,
        "settling": 0.0,
        "relative_decrease": 0.01,
        "loss": "none",
        "loss_scale": 3.0,
        "bridge": 0.0,
    },
}
"""Sections III and IV-A of the paper. Clusters are user-specified there: 0.1 s or 20 000 events."""

PRESETS: dict[str, dict[str, Any]] = {"auto": AUTO, "paper": PAPER}
"""Values of fields that differ from their own defaults, by the name of the preset and the stage."""


def with_preset(values: Mapping[str, Any], preset: Mapping[str, Any]) -> dict[str, Any]:
    """Return a preset's values, overridden by those given, at every level."""
    merged = dict(preset)
    for name, value in values.items():
        below = merged.get(name)
        if isinstance(value, Mapping) and isinstance(below, Mapping):
            value = with_preset(value, below)
        merged[name] = value
    return merged
