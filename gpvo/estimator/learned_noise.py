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
    """Lets Q_c follow the motion, and R the residuals in the window, if they have a memory."""

    def __init__(self, start: NoiseConfig) -> None:
        self._start = start
        self._motion = MotionNoise(np.array(start.acceleration_psd), start.motion_memory)
        information = np.array(start.measurement_information)
        self._errors = MeasurementNoise(information, start.measurement_memory)

    @property
    def now(self) -> NoiseConfig:
        """The noise as it is known now."""
        found: dict[str, tuple[float, ...]] = {}
        if self._start.motion_memory > 0:
            found["acceleration_psd"] = tuple(self._motion.qc.tolist())
        if self._start.measurement_memory > 0:
            found["measurement_information"] = tuple(self._errors.information.tolist())
        return self._start.model_copy(update=found)

    def learn_motion(
        self, states: States, covariance: Array, linearized: States | None, acceleration: Array
    ) -> None:
        """Learn Q_c, see `MotionNoise.learn`."""
        self._motion.learn(states, covariance, linearized, acceleration)

    def learn_errors(self, landmarks: WindowLandmarks, window: NumberedStates) -> None:
        """Learn R from the measurements in the window, if that is due."""
        t, factor = float(window.states.t[-1]), landmarks.factor
        if factor is None or self._start.measurement_memory == 0 or not self._errors.is_due(t):
            return
        if (interval := landmarks.interval) is not None:
            residuals = factor.residuals(window.values()) / factor.deviations
            self._errors.learn(t, residuals, factor.redundancy, interval)
