"""Section III-A.2: features that are followed by the patch around them."""

from __future__ import annotations

from pydantic import Field

from gpvo.config.stages.stage import LARGEST_SIDE, StageConfig

LARGEST_PATCH = 31
"""Side of a patch in the pictures of large sensors, pixels."""


class KltConfig(StageConfig):
    """Features followed around the quad by the patch that surrounds them (Lucas-Kanade)."""

    smoothing: float = Field(
        default=0.7,
        gt=0,
        description="Standard deviation of the Gaussian blur of event images, pixels.",
    )
    patch_size: int | None = Field(
        default=None,
        ge=5,
        le=1000,
        description="Side of the patch, pixels; null for what suits the focal length: 1.8 times "
        "its square root, at most 31.",
    )
    pyramid_levels: int = Field(
        default=3, ge=0, le=30, description="Coarser pyramid levels above the image."
    )
    max_features: int = Field(
        default=300, ge=1, description="Most features per frame and resolution."
    )
    usual_features: int = Field(
        default=200,
        ge=1,
        description="Features per frame, up to `max_features`, however soon frames follow each "
        "other.",
    )
    feature_rate: float = Field(
        default=4500.0,
        ge=0,
        description="Features per second of all frames together that there is time for: where "
        "frames follow each other more slowly, each has more.",
    )
    spacing: int = Field(
        default=8, ge=1, le=LARGEST_SIDE, description="Smallest distance between features, pixels."
    )
    crowding: float | None = Field(
        default=1.5,
        ge=1,
        description="The first features are found where a sixteenth of the image has at most so "
        "many times its share of `max_features`: something that moves by itself does not get most "
        "of them. Later ones may be anywhere. null for no limit.",
    )
    candidates: float = Field(
        default=2.0,
        ge=1,
        description="So many times as many new features are looked at as there is room for, and "
        "those are taken that together tell most of the pose while the motion keeps them in view; "
        "1 takes the strongest ones.",
    )
    closure_tolerance: float = Field(
        default=0.5,
        gt=0,
        description="How near to its start a quad must end, pixels, in a clean stream; among noise "
        "it is divided by the contours' share of the events.",
    )
    row_tolerance: float = Field(
        default=1.5, gt=0, description="Largest row difference between left and right, pixels."
    )
    min_correlation: float = Field(
        default=0.3,
        ge=-1,
        le=1,
        description="Least correlation between left and right in the middle of the patch, half its "
        "side; -1 asks for none.",
    )
    min_row_gradient: float = Field(
        default=8.0,
        ge=0,
        description="Least root mean square of the left image's gradient along the row in the same "
        "middle, of 255 per pixel: a disparity is measured there, not at the patch's margins; 0 "
        "asks for none.",
    )
    anchor_correlation: float = Field(
        default=0.6,
        ge=-1,
        le=1,
        description="Least correlation of a landmark's anchor, the patch of its first sight warped "
        "by the motion since then, with the image; below it the landmark gets a new one. 1 gives "
        "it a new one in each frame.",
    )
    slopes: bool = Field(
        default=True,
        description="Surfaces have the slope that left and right patches tell; otherwise they are "
        "taken to face the camera.",
    )
    anchor_tolerance: float = Field(
        default=1.0,
        gt=0,
        description="Largest distance between the match with the previous frame and the match "
        "with the anchor, pixels; beyond it the landmark is dropped.",
    )
    deviations: bool = Field(
        default=True,
        description="Each measurement has its own standard deviations, by its patch's gradients "
        "and the correlation of left and right; otherwise all have those of R.",
    )
    lost_landmarks: int = Field(
        default=900,
        ge=0,
        description="Landmarks that were lost, which are searched where the motion brings them "
        "back into view: two thirds the latest, the others spread over all before; 0 for none.",
    )
    search_tolerance: float = Field(
        default=3.0,
        gt=0,
        description="Largest distance of a landmark that is found again from where the motion "
        "takes it, or from there as several others are, pixels; its half for disparities.",
    )

    @property
    def side(self) -> int:
        """Side of the patch, pixels: the largest one before the camera is known."""
        return self.patch_size or LARGEST_PATCH

    def features(self, seconds: float) -> int:
        """Return how many features a frame may have, so many seconds after the one before."""
        paced = max(self.usual_features, self.feature_rate * seconds)
        return int(min(paced, self.max_features))
