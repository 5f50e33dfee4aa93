"""Configuration of every stage; `preset: paper` has the paper's values."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from gpvo.config.presets import PRESETS, with_preset


class StageConfig(BaseModel):
    """Base of the stages' models: immutable, and a misspelt field is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ClusteringConfig(StageConfig):
    """Section III-A.1: when a cluster of events ends."""

    window: float = Field(
        default=0.25,
        gt=0,
        description="Longest duration of a cluster, seconds: that of slow motion, and of a camera "
        "at rest. 0.1 in the paper.",
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


class FeatureConfig(StageConfig):
    """LIBVISO2's blob and corner detector."""

    nms_radius: int = Field(
        default=3, ge=1, description="Half window of non-maximum suppression, pixels."
    )
    response_threshold: float = Field(
        default=50.0, ge=0, description="Smallest magnitude of a filter response that is a feature."
    )


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
        description="Side of the patch, pixels; null for what suits the focal length: 1.8 times "
        "its square root, at most 31.",
    )
    pyramid_levels: int = Field(
        default=3, ge=0, description="Coarser pyramid levels above the image."
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
    spacing: int = Field(default=8, ge=1, description="Smallest distance between features, pixels.")
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


class Viso2Config(StageConfig):
    """LIBVISO2's circular matching of descriptors."""

    smoothing: float = Field(
        default=1.5,
        ge=0,
        description="Standard deviation of the Gaussian blur of event images, pixels. 0 is "
        "LIBVISO2, which knows grey images: of a raw binary frame few features are found again.",
    )
    flow_radius: int = Field(
        default=40, ge=1, description="Search half range per frame of temporal distance, pixels."
    )
    max_disparity: int = Field(
        default=100, ge=1, description="Search range of stereo matches, pixels."
    )
    row_tolerance: int = Field(
        default=1, ge=0, description="Largest row difference between left and right, pixels."
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
        default=50, ge=1, description="Side of the cells that few features are kept of, pixels."
    )
    bucket_features: int = Field(
        default=0,
        ge=0,
        description="Features per cell, those of the longest tracklets, then the strongest; 2 in "
        "LIBVISO2. 0 keeps all.",
    )


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
        description="Number of earlier frames that tracklets of LIBVISO2's features are extended "
        "over; patches have anchors instead.",
    )
    features: FeatureConfig = FeatureConfig()
    klt: KltConfig = KltConfig()
    viso2: Viso2Config = Viso2Config()
    compensation: CompensationConfig = CompensationConfig()

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


class TrackletConfig(StageConfig):
    """Section III-A.2: measurement times and the four filters."""

    time_radius: float = Field(
        default=15.0,
        ge=0,
        description="A feature's time is the mean of the SAE within this radius, tracked pixels: "
        "the patch that is tracked. 0 takes the nearest event's time alone, as the paper does.",
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
        default=2.0, ge=0, description="Smallest image motion, tracked pixels."
    )
    min_duration: float = Field(
        default=0.015, ge=0, description="Shortest duration, seconds; 0.04 in the paper."
    )
    rest_duration: float = Field(
        default=0.4,
        ge=0,
        description="Duration from which a tracklet passes however short it is, seconds: the "
        "camera hardly moves; 0 for never, as in the paper.",
    )
    first_share: float = Field(
        default=0.5,
        ge=0,
        le=1,
        description="Share of the landmarks seen again that must pass these filters before the "
        "motion begins to be estimated, in the first 0.2 seconds: those that pass first may move "
        "by themselves. 0 begins with any, as in the paper.",
    )
    history: int = Field(
        default=10,
        ge=2,
        description="Clusters that tracklets are remembered for; in slow motion they take long to "
        "reach `min_length`.",
    )


class McRansacConfig(StageConfig):
    """Section III-B: motion-compensated RANSAC."""

    iterations: int = Field(default=10_000, ge=1, description="Samples of the fast version.")
    sample_size: int = Field(default=3, ge=3, description="Tracklets per sample, M_rand.")
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
        default=4, ge=1, description="Clusters between the two measurements of a segment, at most."
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


Vector3 = tuple[float, float, float]
Vector6 = tuple[float, float, float, float, float, float]


class NoiseConfig(StageConfig):
    """Section IV: the covariances of motion and measurements."""

    acceleration_psd: Vector6 = Field(
        default=(1 / 500, 1 / 500, 1 / 500, 1 / 50, 1 / 50, 1 / 50),
        description="Diagonal of Q_c, the power spectral density of the white noise on body "
        "acceleration: rotation (rad^2/s^3), then translation (m^2/s^3).",
    )
    measurement_information: Vector3 = Field(
        default=(13.0, 13.0, 22.0),
        description="Diagonal of R^-1, the inverse covariance of (u_left, v, disparity), tracked "
        "pixel^-2: what `gpvo tune-noise` learns of patches on motion-compensated images. The "
        "paper's features have (0.5, 0.5, 0.1).",
    )
    track_drift: float = Field(
        default=0.25,
        ge=0,
        description="Standard deviation of what a track moves on its landmark where the look of "
        "that changes by one, tracked pixels: the image motion turns by 60 degrees (by two: is "
        "reversed), or the landmark comes e times nearer. The variance grows with the change. 0 "
        "takes a landmark for a point, as the paper does.",
    )
    disparity_drift: float = Field(
        default=0.2,
        ge=0,
        description="Share of `track_drift` that the disparity has: both pictures move alike.",
    )
    motion_memory: float = Field(
        default=0.0,
        ge=0,
        description="How long the motion is remembered that Q_c follows, seconds: "
        "`acceleration_psd` is where it starts. 0 keeps that value, as in the paper.",
    )
    acceleration_memory: float = Field(
        default=0.0,
        ge=0,
        description="The acceleration in the latest two updates, which only later ones measure, is "
        "white noise about its mean before them, in this many times an update's time. 0 has it "
        "about zero, as in the paper.",
    )
    measurement_memory: float = Field(
        default=0.0,
        ge=0,
        description="How long the residuals are remembered that the scale of R follows, seconds: "
        "`measurement_information` is where it starts. 0 keeps that value, as in the paper.",
    )
    velocity_share: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="Share of a velocity's variance that is its error amid other states: 1 where "
        "the acceleration is white noise, as in the paper; 1/4 where the motion is smooth, as that "
        "of a hand, a car or a drone. It changes no estimate.",
    )
    initial_velocity: float = Field(
        default=1.0, gt=0, description="Standard deviation of the first velocity, rad/s and m/s."
    )


class EstimatorConfig(StageConfig):
    """Section III-C: the sliding window or fixed-lag smoother."""

    method: Literal["fixed_lag", "batch"] = Field(
        default="fixed_lag",
        description="fixed_lag: GTSAM's IncrementalFixedLagSmoother, which keeps what is known "
        "from before the window and takes factors of your own; batch: Gauss-Newton over the window "
        "alone, every state and landmark a variable of a GTSAM graph, as in the paper.",
    )
    interval: float = Field(
        default=0.02,
        ge=0,
        description="Shortest time between two updates, seconds: shorter clusters are estimated "
        "together. 0 updates at every cluster, as in the paper.",
    )
    window: int = Field(
        default=5,
        ge=2,
        description="Lag in updates, which are at clusters' ends: how many of the latest are in "
        "the window.",
    )
    lost_landmarks: int = Field(
        default=900,
        ge=0,
        description="Landmarks that fixed_lag remembers when they are not measured in the window "
        "any more, because they may be known again: two thirds the latest, the others spread over "
        "all before. 0 for none.",
    )
    lag: float | None = Field(
        default=None,
        gt=0,
        description="Lag in seconds, instead of the one in clusters; null for that one.",
    )
    settling: float = Field(
        default=0.25,
        ge=0,
        description="Time in which states that left the window of fixed_lag still follow its "
        "corrections, which else are a step in the path, seconds: later they are final. 0 moves "
        "the states since the key state before alone.",
    )
    state_interval: float = Field(
        default=0.0,
        ge=0,
        description="0 for unique times: every time of a measurement is a state, as in the paper. "
        "Otherwise key times: states at most this far apart, seconds, such as 0.025, and each "
        "measurement between them at its own time, interpolated.",
    )
    relative_decrease: float = Field(
        default=0.01,
        gt=0,
        lt=1,
        description="Gauss-Newton of batch ends when the cost changes by less than this share.",
    )
    iterations: int = Field(
        default=15, ge=1, description="Largest number of Gauss-Newton steps of batch."
    )
    loss: Literal["none", "huber", "cauchy", "geman_mcclure"] = Field(
        default="none",
        description="Loss of a measurement's error: none is least squares, as in the paper.",
    )
    loss_scale: float = Field(
        default=3.0,
        gt=0,
        description="Error beyond which a loss lets go, standard deviations (norm).",
    )
    gate: float = Field(
        default=0.0,
        ge=0,
        lt=1,
        description="Leave out new measurements whose Mahalanobis distance from their prediction "
        "is larger than that of this share of all inliers, such as 0.9999; 0 takes all.",
    )
    bridge: float = Field(
        default=0.0,
        ge=0,
        description="How long the velocity is kept where nothing measures it, seconds: later the "
        "camera is as likely to stand still, and after such a break the motion is estimated anew. "
        "0 keeps it for ever, as in the paper.",
    )
    covariance_interval: float = Field(
        default=0.02,
        gt=0,
        description="Time between states whose joint covariance is kept, seconds.",
    )

    @model_validator(mode="before")
    @classmethod
    def _name_what_is_new(cls, values: Any) -> Any:
        """Name the present value of what earlier versions had."""
        if isinstance(values, dict):
            for field, old, new in (
                ("method", "gauss_newton", "method: fixed_lag has a state at every unique time"),
                ("loss", "gnc", "the loss is called geman_mcclure"),
                ("landmarks", None, "leave it out: fixed_lag eliminates landmarks and loses none"),
            ):
                if field in values and old in (None, values[field]):
                    raise ValueError(f"{field}: {values[field]} is no longer there; {new}")
        return values


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
