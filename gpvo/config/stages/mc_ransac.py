"""Section III-B: which tracklets agree with one velocity."""

from __future__ import annotations

from pydantic import Field

from gpvo.config.stages.stage import StageConfig


class McRansacConfig(StageConfig):
    """Section III-B: motion-compensated RANSAC."""

    iterations: int = Field(
        default=10_000, ge=1, le=1_000_000, description="Samples of the fast version."
    )
    sample_size: int = Field(default=3, ge=3, le=100, description="Tracklets per sample, M_rand.")
    relative_threshold: float = Field(
        default=0.05, gt=0, description="Largest e_rel of an inlier: error over segment length."
    )
    pixel_threshold: float = Field(
        default=1.5,
        ge=0,
        description="Errors up to this are inliers however short the segment, tracked pixels; "
        "0 for the paper's rule.",
    )
    disparity_tolerance: float = Field(
        default=0.45,
        ge=0,
        description="Error of a disparity, tracked pixels, three standard deviations: its share of "
        "the disparity is that of the depth, and as large a share of a segment's length is no sign "
        "of an outlier. 0 for the paper's rule.",
    )
    span: int = Field(
        default=4,
        ge=1,
        description="Clusters between the two measurements of a segment, at most, of clusters that "
        "follow each other: with `clustering.spacing` they are so many times fewer, at least one.",
    )
    confidence: float = Field(
        default=0.9999,
        gt=0,
        le=1,
        description="Stop drawing once a sample free of outliers was drawn with this probability; "
        "1 draws all `iterations`, as the paper does.",
    )
    track_record: bool = Field(
        default=True,
        description="Landmarks that were outliers more often than inliers propose no velocity, "
        "unless most were: they may move by themselves.",
    )
    refinements: int = Field(
        default=5,
        ge=1,
        description="Times that the velocity is refined on its inliers and the segments are judged "
        "again, at most; it ends when the inliers stay. Once in the paper.",
    )
    refinement_iterations: int = Field(
        default=20,
        ge=1,
        le=1_000_000,
        description="Largest number of Gauss-Newton steps of the iterative version.",
    )
    refinement_tolerance: float = Field(
        default=1e-6,
        gt=0,
        description="Step of the velocity that ends Gauss-Newton, rad/s and m/s.",
    )
    max_condition: float = Field(
        default=1e10,
        gt=1,
        description="Condition number beyond which the velocity is undetermined.",
    )
