"""Sections III-C and IV: the estimator, and the noise that it expects."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from gpvo.config.stages.stage import StageConfig

LEAST_NOISE, MOST_NOISE = 1e-12, 1e6
"""Densities and informations that mean something beside others, as that of a thousandth pixel."""
NoiseNumber = Annotated[float, Field(ge=LEAST_NOISE, le=MOST_NOISE)]
LEAST_INTERVAL = 1e-3
"""Seconds between key states, or states with covariances: with less, runs come to no end."""
Vector3 = tuple[NoiseNumber, NoiseNumber, NoiseNumber]
Vector6 = tuple[NoiseNumber, NoiseNumber, NoiseNumber, NoiseNumber, NoiseNumber, NoiseNumber]


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
    track_drift: float | None = Field(
        default=0.25,
        ge=0,
        description="Standard deviation of what a track moves on its landmark where the look of "
        "that changes by one, tracked pixels: the image motion turns by 60 degrees (by two: is "
        "reversed), or the landmark comes e times nearer. The variance grows with the change. "
        "null: the focal length to the power 0.6 over 28, both in tracked pixels. 0 takes a "
        "landmark for a point, as the paper and batch do.",
    )
    disparity_drift: float = Field(
        default=0.2,
        ge=0,
        description="Share of `track_drift` that the disparity has: both pictures move alike.",
    )
    motion_memory: float = Field(
        default=0.0,
        ge=0,
        description="How long fixed_lag remembers the motion that Q_c follows, seconds: "
        "`acceleration_psd` is where it starts. 0 keeps that value, as in the paper.",
    )
    acceleration_memory: float = Field(
        default=0.0,
        ge=0,
        description="The acceleration in the latest two updates, which only later ones measure, is "
        "white noise about its mean before them, in this many times an update's time. 0 has it "
        "about zero, as in the paper and in batch.",
    )
    measurement_memory: float = Field(
        default=0.0,
        ge=0,
        description="How long fixed_lag remembers the residuals that the scale of R follows, "
        "seconds: `measurement_information` is where it starts. 0 keeps it, as in the paper.",
    )
    velocity_share: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="Share of a velocity's variance that is its error amid other states: 1/4 where "
        "the motion is smooth, as that of a hand, a car or a drone. The newest velocities' is then "
        "learned, see `motion_memory`, of what later updates correct them by. 1 where the "
        "acceleration is white noise, as in the paper. It changes no estimate.",
    )
    initial_velocity: float = Field(
        default=1.0,
        ge=1e-6,
        le=1e6,
        description="Standard deviation of the first velocity, rad/s and m/s.",
    )


class EstimatorConfig(StageConfig):
    """Section III-C: the sliding window or fixed-lag smoother."""

    method: Literal["fixed_lag", "batch"] = Field(
        default="fixed_lag",
        description="fixed_lag: GTSAM's IncrementalFixedLagSmoother, which keeps what is known "
        "from before the window and takes factors of your own; batch: Gauss-Newton over the window "
        "alone, every state and landmark a variable of a GTSAM graph, with the noise as it is "
        "given, as in the paper.",
    )
    interval: float = Field(
        default=0.02,
        ge=0,
        description="Shortest time between two updates, seconds: shorter clusters are estimated "
        "together. 0 updates at every cluster, as in the paper.",
    )
    start_landmarks: int = Field(
        default=20,
        ge=0,
        le=1_000_000,
        description="The trajectory begins at the first cluster that has measurements of so many "
        "landmarks, or after half a second with whatever there is. 0 begins with the first "
        "measurement, as in the paper.",
    )
    window: int = Field(
        default=5,
        ge=2,
        le=1_000_000,
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
        "It is to be longer than clusters are apart. 0 keeps it for ever, as in the paper.",
    )
    covariance_interval: float = Field(
        default=0.02,
        ge=LEAST_INTERVAL,
        description="Time between states whose joint covariance is kept, seconds.",
    )

    @field_validator("state_interval")
    @classmethod
    def _is_none_or_long(cls, value: float) -> float:
        """Refuse key states that are nearer than any measurements."""
        if 0 < value < LEAST_INTERVAL:
            raise ValueError(f"give 0 for unique times, or at least {LEAST_INTERVAL} s")
        return value

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
