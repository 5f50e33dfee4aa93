"""The factors of section III-C: WNOA priors between states, and measurements of landmarks.

State k has the keys X(k), its Pose3 T_world_cam, and V(k), its body twist; landmark l is the Point3
L(l) in the world, where it is a variable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray

from factors import (
    InterpolatedStereoFactor,
    LandmarkPrior,
    StereoCamera,
    StereoReprojectionFactor,
    StructurelessStereoFactor,
    WnoaPriorFactor,
)
from gpvo.config.stages import EstimatorConfig, NoiseConfig
from gpvo.estimator.state_times import SAME_TIME
from gpvo.tracking.measurements import Measurements

Array = NDArray[np.float64]


@dataclass
class GraphBuilder:
    """Makes the factors of one camera with one set of noise parameters."""

    camera: StereoCamera
    noise: NoiseConfig
    config: EstimatorConfig

    @property
    def qc(self) -> Array:
        """(6,) diagonal of the power spectral density of the acceleration."""
        return np.array(self.noise.acceleration_psd)

    @property
    def unique_times(self) -> bool:
        """Whether every time of a measurement is a state of its own."""
        return self.config.state_interval == 0

    def measurement_noise(self, deviation: Array | float = 1.0) -> gtsam.noiseModel.Base:
        """Return GTSAM's noise model of one measurement, with the configured loss.

        Its standard deviations are `deviation` (3,) times those that R says.
        """
        information = np.diag(self.noise.measurement_information / np.square(deviation))
        gaussian = gtsam.noiseModel.Gaussian.Information(information)
        if self.config.loss == "none":
            return gaussian
        estimators = gtsam.noiseModel.mEstimator
        losses: dict[str, Any] = {
            "huber": estimators.Huber,
            "cauchy": estimators.Cauchy,
            "geman_mcclure": estimators.GemanMcClure,
        }
        loss = losses[self.config.loss].Create(self.config.loss_scale)
        return gtsam.noiseModel.Robust.Create(loss, gaussian)

    def prior_on_first_state(
        self, state: int, T_world_cam: Array, twist: Array, covariance: Array
    ) -> list[gtsam.NonlinearFactor]:
        """Make priors on a state from a covariance (12, 12), pose and twist apart."""
        of_pose = gtsam.noiseModel.Gaussian.Covariance(covariance[:6, :6])
        of_twist = gtsam.noiseModel.Gaussian.Covariance(covariance[6:, 6:])
        return [
            gtsam.PriorFactorPose3(X(state), gtsam.Pose3(T_world_cam), of_pose),
            gtsam.PriorFactorVector(V(state), twist, of_twist),
        ]

    def motion(
        self,
        states: Sequence[int],
        t: Array,
        density: Array | None = None,
        acceleration: Array | None = None,
    ) -> list[gtsam.NonlinearFactor]:
        """Make the WNOA prior between each state and the next; t (K,) are their times, seconds.

        `density` (K - 1, 6) are the diagonals of Q_c between them, by default the configured one,
        and `acceleration` (K - 1, 6) is the mean there, by default 0.
        """
        dt = np.diff(t)
        density = np.tile(self.qc, (len(dt), 1)) if density is None else density
        mean = [None] * len(dt) if acceleration is None else acceleration
        pairs = zip(states[:-1], states[1:], dt, density, mean, strict=True)
        return [
            WnoaPriorFactor(X(i), V(i), X(j), V(j), step, qc, acceleration=a)
            for i, j, step, qc, a in pairs
        ]

    def reprojection(
        self, states: Sequence[int], t: Array, measurements: Measurements
    ) -> list[gtsam.NonlinearFactor]:
        """Make a factor for each measurement, at the state of its time or between two states.

        The measurements' times must lie within those of the states, t (K,), up to `SAME_TIME`.
        """
        before = np.clip(np.searchsorted(t, measurements.t + SAME_TIME, "right") - 1, 0, None)
        factors: list[gtsam.NonlinearFactor] = []
        for k, time, landmark, stereo, deviation in zip(
            before.tolist(),
            measurements.t.tolist(),
            measurements.landmark.tolist(),
            measurements.stereo,
            measurements.deviations,
            strict=True,
        ):
            point, model = L(landmark), self.measurement_noise(deviation)
            if time - t[k] <= SAME_TIME:
                at_state = StereoReprojectionFactor(stereo, model, X(states[k]), point, self.camera)
                factors.append(at_state)
                continue
            i, j = states[k], states[k + 1]
            keys, times = (X(i), V(i), X(j), V(j), point), (t[k], t[k + 1], time)
            factors.append(InterpolatedStereoFactor(stereo, model, *keys, self.camera, *times))
        return factors

    def structureless(
        self,
        states: Sequence[int],
        t: Array,
        measurements: Measurements,
        prior: LandmarkPrior | None = None,
    ) -> StructurelessStereoFactor:
        """Make one factor of all measurements, their landmarks and unique times eliminated."""
        return StructurelessStereoFactor(
            measurements.stereo,
            np.clip(measurements.t, t[0], t[-1]),
            measurements.landmark,
            self.measurement_noise(),
            [(X(k), V(k), time) for k, time in zip(states, t.tolist(), strict=True)],
            self.camera,
            self.qc if self.unique_times else None,
            LandmarkPrior.none() if prior is None else prior,
            deviations=measurements.deviations,
        )
