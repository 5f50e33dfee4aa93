"""Section III-A.2: LIBVISO2's features and how they are matched."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gpvo.config.stages.stage import LARGEST_SIDE, StageConfig


class FeatureConfig(StageConfig):
    """LIBVISO2's blob and corner detector."""

    nms_radius: int = Field(
        default=3, ge=1, description="Half window of non-maximum suppression, pixels."
    )
    response_threshold: float = Field(
        default=50.0, ge=0, description="Smallest magnitude of a filter response that is a feature."
    )


class Viso2Config(StageConfig):
    """LIBVISO2's circular matching of descriptors."""

    smoothing: float = Field(
        default=1.5,
        ge=0,
        description="Standard deviation of the Gaussian blur of event images, pixels. 0 is "
        "LIBVISO2, which knows grey images: of a raw binary frame few features are found again.",
    )
    flow_radius: int = Field(
        default=40,
        ge=1,
        le=LARGEST_SIDE,
        description="Search half range per frame of temporal distance, pixels.",
    )
    max_disparity: int = Field(
        default=100, ge=1, le=LARGEST_SIDE, description="Search range of stereo matches, pixels."
    )
    row_tolerance: int = Field(
        default=1,
        ge=0,
        le=LARGEST_SIDE,
        description="Largest row difference between left and right, pixels.",
    )
    two_stage: bool = Field(
        default=True,
        description="Match a sparse set of features first, and search for the others only where "
        "the matches around them went.",
    )
    sparse_nms_radius: int = Field(
        default=9,
        ge=1,
        description="Half window of non-maximum suppression of the sparse set, pixels.",
    )
    range_cell: int = Field(
        default=50,
        ge=1,
        le=LARGEST_SIDE,
        description="Side of the cells that have search ranges of their own, pixels.",
    )
    least_range: float = Field(
        default=20.0, ge=0, description="Width below which a search range is widened, pixels."
    )
    outlier_flow_tolerance: float = Field(
        default=5.0,
        gt=0,
        description="Flow difference (L1) up to which Delaunay neighbours agree, pixels.",
    )
    outlier_disparity_tolerance: float = Field(
        default=5.0,
        gt=0,
        description="Disparity difference up to which Delaunay neighbours agree, pixels.",
    )
    min_support: int = Field(
        default=4,
        ge=0,
        description="Edges to Delaunay neighbours that must agree, one between two triangles "
        "counting twice; 0 keeps all matches.",
    )
    refinement: Literal["none", "pixel", "subpixel"] = Field(
        default="subpixel",
        description="How far positions are refined on the gradients around them.",
    )
    bucket_size: int = Field(
        default=50,
        ge=1,
        le=LARGEST_SIDE,
        description="Side of the cells that few features are kept of, pixels.",
    )
    bucket_features: int = Field(
        default=0,
        ge=0,
        description="Features per cell, those of the longest tracklets, then the strongest; 2 in "
        "LIBVISO2. 0 keeps all.",
    )
