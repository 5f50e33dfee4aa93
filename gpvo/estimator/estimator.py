"""The estimators of section III-C, by the name that the configuration gives them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from factors import StereoCamera
from gpvo.config.stages import EstimatorConfig, NoiseConfig
from gpvo.estimator.batch_window import SlidingWindow
from gpvo.estimator.diagnostics import Repair
from gpvo.estimator.gauss_newton_smoother import GaussNewtonSmoother
from gpvo.estimator.smoother import FixedLagSmoother
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.states import States
from gpvo.trajectory.trajectory import Trajectory


class Estimator(Protocol):
    """Turns inlier measurements into states of a continuous trajectory.

    What it had to leave out or rebuild is listed in `repairs`.
    """

    repairs: list[Repair]

    def update(
        self, frame: int, stop: float, measurements: Measurements, fit: VelocityFit | None
    ) -> States:
        """Take what cluster number `frame`, which ended at `stop` seconds, added.

        Returned are the states in the window as they are estimated now.
        """
        ...

    def settled(self, after: float) -> States:
        """States later than `after` seconds that will not change any more."""
        ...

    def trajectory(self, start_ns: int) -> Trajectory | None:
        """The trajectory so far; None before the first measurement."""
        ...


def make_estimator(camera: StereoCamera, noise: NoiseConfig, config: EstimatorConfig) -> Estimator:
    """The configured estimator."""
    methods: dict[str, Callable[[StereoCamera, NoiseConfig, EstimatorConfig], Estimator]] = {
        "gauss_newton": GaussNewtonSmoother,
        "fixed_lag": FixedLagSmoother,
        "batch": SlidingWindow,
    }
    return methods[config.method](camera, noise, config)
