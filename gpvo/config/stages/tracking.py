"""Section III-A.2: event images, and which features are tracked in them."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from gpvo.config.stages.klt import KltConfig
from gpvo.config.stages.stage import StageConfig
from gpvo.config.stages.viso2 import FeatureConfig, Viso2Config


class CompensationConfig(StageConfig):
    """Motion-compensated images."""

    reach: float = Field(
        default=24.0,
        gt=0,
        description="Standard deviation of the weights with which features tell the image motion "
        "around them, pixels.",
    )
    time_radius: float = Field(
        default=15.0,
        gt=0,
        description="A feature's time is the mean of the events within this radius, pixels: the "
        "patch that is tracked.",
    )
    lag_share: float = Field(
        default=0.5,
        ge=0,
        description="How far contours are seen behind where they are, over the way between two "
        "events of a pixel, which is the contrast threshold over the gradient of the logarithmic "
        "brightness and found from the stream: half by theory. Observations are moved ahead by it; "
        "0 leaves them.",
    )
    little_motion: float = Field(
        default=1.5,
        ge=0,
        description="Where contours moved by less since the picture before, pixels, as their few "
        "events tell, the picture goes on showing the events before, too, and what is seen in it "
        "is less certain by that way: such as where the motion turns. 0 shows the new ones alone.",
    )
    sharpest: bool = Field(
        default=True,
        description="Where no features are followed into a cluster, move the events of the next "
        "one so that its picture is sharpest; false moves them as before.",
    )
    density: float | None = Field(
        default=0.5,
        gt=0,
        description="Events per pixel of a picture that are enough: where there are twice as "
        "many, one of several is drawn; null draws all.",
    )


class TrackingConfig(StageConfig):
    """Section III-A.2: detection, quad matching and extension over earlier frames."""

    tracker: Literal["klt", "viso2"] = Field(
        default="klt",
        description="How features are matched: by the patch around them (Lucas-Kanade), or by "
        "LIBVISO2's descriptors, the paper's choice.",
    )
    resolutions: tuple[Literal[1, 2], ...] | None = Field(
        default=None,
        min_length=1,
        description="Image resolutions that are tracked independently: 1 full, 2 half; null for "
        "the full one up to 640 x 480 and the half one of larger sensors. The paper takes both. "
        "The pixels of the finest are the tracked pixels that other fields speak of.",
    )
    image: Literal["binary", "time_surface", "motion_compensated"] = Field(
        default="motion_compensated",
        description="What is tracked of a cluster's events: that there was one, as in the paper, "
        "how late in the cluster the latest one was, or how many there were where they would have "
        "been in the cluster's middle.",
    )
    earlier_frames: int = Field(
        default=4,
        ge=1,
        le=1000,
        description="Number of earlier frames that tracklets of LIBVISO2's features are extended "
        "over; patches have anchors instead.",
    )
    features: FeatureConfig = FeatureConfig()
    klt: KltConfig = KltConfig()
    viso2: Viso2Config = Viso2Config()
    compensation: CompensationConfig = CompensationConfig()

    @field_validator("resolutions")
    @classmethod
    def _are_different(cls, value: tuple[int, ...] | None) -> tuple[int, ...] | None:
        """Refuse a resolution that is tracked twice: its measurements would count twice."""
        if value is not None and len(set(value)) < len(value):
            raise ValueError("each resolution can be tracked once; name it once")
        return value

    @model_validator(mode="before")
    @classmethod
    def _name_what_is_new(cls, values: Any) -> Any:
        """Name the present value of what earlier versions had."""
        if isinstance(values, dict) and (values.get("tracker") == "event" or "event" in values):
            raise ValueError(
                "the tracker event and its fields are no longer there; leave them out: tracker: klt"
                " is more accurate and faster"
            )
        return values

    @property
    def pixel(self) -> int:
        """Side of a tracked pixel, pixels of the sensor."""
        return min(self.resolutions or (1,))
