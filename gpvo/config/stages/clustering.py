"""Section III-A.1: clusters of events."""

from __future__ import annotations

from pydantic import Field

from gpvo.config.stages.stage import StageConfig


class ClusteringConfig(StageConfig):
    """Section III-A.1: when a cluster of events ends."""

    window: float = Field(
        default=0.5,
        ge=1e-3,
        description="Longest duration of a cluster, seconds: that of slow motion. User-specified "
        "in the paper.",
    )
    motion: float = Field(
        default=2.2,
        gt=0,
        description="Image motion of the slower features during a cluster, tracked pixels.",
    )
    blur: float = Field(
        default=0.1,
        gt=0,
        description="By how much contours leave a constant motion during a cluster in fast motion, "
        "tracked pixels: as long as the motion stays, compensated images of longer clusters are as "
        "sharp, and each costs the same time.",
    )
    shortest: float = Field(
        default=0.01, ge=0, description="Shortest duration of a cluster by the blur, seconds."
    )
    steady: float = Field(
        default=0.05,
        gt=0,
        description="Longest duration of a cluster by the blur, seconds, in motion that does not "
        "change.",
    )
    lively_motion: float = Field(
        default=1.5,
        gt=0,
        description="As `motion`, in lively motion, of which Q_c is large, tracked pixels.",
    )
    lively_steady: float = Field(
        default=0.035,
        gt=0,
        description="As `steady`, in lively motion, seconds.",
    )
    picture: float = Field(
        default=0.3,
        ge=0,
        description="Events per pixel of either camera, noise not counted, that clusters in lively "
        "motion have even so.",
    )
    spacing: float = Field(
        default=2.0,
        ge=1,
        description="A cluster begins up to so many times its length after the one before; the "
        "events between are left out. 1 takes all events.",
    )
    stride: float = Field(
        default=8.0,
        gt=0,
        description="Image motion of the slower features from one cluster's begin to the next "
        "one's, up to which events between are left out, tracked pixels.",
    )
    uncertainty: float = Field(
        default=0.05,
        gt=0,
        description="Standard deviation of the image half-way between the begins of two clusters, "
        "given both, up to which events between are left out, tracked pixels: livelier motion, of "
        "which Q_c is larger, is looked at more often.",
    )
    max_events: int | None = Field(
        default=None,
        gt=0,
        description="Events of either camera that end a cluster early, instead of the motion: the "
        "paper's way, which fits one sensor and one scene. null for the motion.",
    )
    skip_flashes: bool = Field(
        default=True,
        description="Leave out stretches in which all pixels fire at once, such as when a lamp is "
        "switched.",
    )
    background_filter: float | None = Field(
        default=None,
        ge=0,
        description="Drop events without two of the same polarity in the pixels around within this "
        "time before, seconds; 0 keeps all, null finds the time from the background activity while "
        "the stream runs, and leaves a clean stream alone.",
    )
    hot_pixel_ratio: float = Field(
        default=10.0,
        ge=0,
        description="Drop events of pixels that had more recent events than this many times those "
        "of the pixels around them; 0 keeps all.",
    )
