"""The estimators of section III-C, by the name that the configuration gives them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from factors import StereoCamera
from gpvo.config.stages import EstimatorConfig, NoiseConfig
from gpvo.estimator.batch_window import SlidingWindow
from gpvo.estimator.diagnostics import Diagnostic
from gpvo.estimator.smoother import FixedLagSmoother
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.motion_estimate import MotionEstimate
from gpvo.trajectory.states import States
from gpvo.trajectory.trajectory import Trajectory


class Estimator(Protocol):
    """Turns inlier measurements into states of a continuous trajectory.

    What it had to leave out or rebuild is listed in `diagnostics`. A method `prepare`, if it has
    one, is called after each update's results are out: it does what the next one needs of them. A
    method `awaits_place(stop, measurements)`, if it has one, tells whether these wait until later.
    """

    diagnostics: list[Diagnostic]

    def update(
        self,
        end_time: float,
        measurements: Measurements,
        velocity_estimate: VelocityFit | None = None,
    ) -> None:
        """Take what clusters added, the last of which ended at `end_time`, seconds."""
        ...

    @property
    def states(self) -> States:
        """States that may still change, as estimated now."""
        ...

    def final_states(self, after: float = ...) -> States:
        """Return states later than `after`, seconds, that will not change any more."""
        ...

    def latest(self) -> MotionEstimate | None:
        """Return the newest state, in constant time; None before the first measurement."""
        ...

    def trajectory(self, start_ns: int = ...) -> Trajectory | None:
        """Return the trajectory so far; None before the first measurement."""
        ...


def make_estimator(camera: StereoCamera, noise: NoiseConfig, config: EstimatorConfig) -> Estimator:
    """Make the configured estimator."""
    methods: dict[str, Callable[[StereoCamera, NoiseConfig, EstimatorConfig], Estimator]] = {
        "fixed_lag": FixedLagSmoother,
        "batch": SlidingWindow,
    }
    return methods[config.method](camera, noise, config)
