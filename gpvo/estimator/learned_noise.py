"""The noise of motion and measurements as it is learned while the smoother runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.config.stages import NoiseConfig
from gpvo.estimator.graph_update import NumberedStates
from gpvo.estimator.measurement_noise import MeasurementNoise
from gpvo.estimator.motion_noise import MotionNoise
from gpvo.estimator.window_landmarks import WindowLandmarks
from gpvo.trajectory.states import States

Array = NDArray[np.float64]


class LearnedNoise:
    """Lets Q_c follow the motion, and R the residuals in the window, if they have a memory.

    If both have, all variances count `MeasurementNoise.variance_factor` times. That changes no
    estimate, but its covariance.

    Attributes
    ----------
    now
        The noise as it is known now, with that factor.
    """

    def __init__(self, start: NoiseConfig) -> None:
        self.now = self._found = start
        self._is_all = start.motion_memory > 0 and start.measurement_memory > 0
        self._motion = MotionNoise(np.array(start.acceleration_psd), start.motion_memory)
        information = np.array(start.measurement_information)
        self._errors = MeasurementNoise(information, start.measurement_memory)

    def learn_motion(self, states: States, covariance: Array, linearized: States | None) -> None:
        """Learn Q_c, see `MotionNoise.learn`."""
        self._motion.learn(states, covariance / self._factor, linearized)
        self._set(acceleration_psd=self._motion.qc)

    def learn_errors(self, landmarks: WindowLandmarks, window: NumberedStates) -> None:
        """Learn R from the measurements in the window, if that is due."""
        t, factor = float(window.states.t[-1]), landmarks.factor
        if factor is None or self.now.measurement_memory == 0 or not self._errors.is_due(t):
            return
        if (interval := landmarks.interval) is not None:
            residuals = factor.residuals(window.values()) / factor.deviations
            self._errors.learn(t, residuals, factor.redundancy, interval)
            self._set(measurement_information=self._errors.information)

    @property
    def _factor(self) -> float:
        return self._errors.variance_factor if self._is_all else 1.0

    def _set(self, **learned: Array) -> None:
        values = {name: tuple(value.tolist()) for name, value in learned.items()}
        self._found = self._found.model_copy(update=values)
        self.now = scaled(self._found, self._factor)


def scaled(noise: NoiseConfig, factor: float) -> NoiseConfig:
    """Return the noise with all variances so many times as large."""
    root = float(np.sqrt(factor))
    values = {
        "acceleration_psd": tuple(factor * x for x in noise.acceleration_psd),
        "measurement_information": tuple(x / factor for x in noise.measurement_information),
        "track_drift": root * noise.track_drift,
        "known_again": root * noise.known_again,
    }
    return noise.model_copy(update=values)
