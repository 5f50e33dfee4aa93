"""Section III-A.2: times of measurements, and which tracklets are good."""

from __future__ import annotations

from pydantic import Field

from gpvo.config.stages.stage import StageConfig


class TrackletConfig(StageConfig):
    """Section III-A.2: measurement times and the four filters."""

    time_radius: float = Field(
        default=15.0,
        ge=0,
        description="A feature's time is the mean of the SAE within this radius, tracked pixels: "
        "the patch that is tracked. 0 takes the nearest event's time alone, as the paper does. "
        "Features of motion-compensated images have `compensation.time_radius` instead.",
    )
    max_stereo_time_difference: float = Field(
        default=0.020, gt=0, description="Largest time difference between left and right, seconds."
    )
    min_disparity: float = Field(
        default=0.1,
        ge=0,
        description="Smallest disparity, tracked pixels: below it nothing is told of the depth. "
        "What is far tells the rotation, and holds the path of a small baseline. 2 in the paper.",
    )
    min_length: float = Field(
        default=0.0,
        ge=0,
        description="Smallest image motion, tracked pixels; 2 in the paper. Matches are right to "
        "a tenth of a pixel, and a landmark that hardly moves says as much as others.",
    )
    min_duration: float = Field(
        default=0.015, ge=0, description="Shortest duration, seconds; 0.04 in the paper."
    )
    history: int = Field(
        default=10,
        ge=2,
        le=1_000_000,
        description="Clusters that tracklets are remembered for.",
    )
