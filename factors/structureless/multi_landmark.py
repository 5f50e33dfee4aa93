"""Measurements of many landmarks, each at its own time, in one factor without the landmarks.

What `TrackletFactor` is for one landmark: all are eliminated where the factor is evaluated, and
what they tell of the states is compressed to as many rows as the states have columns. GTSAM then
sees a chain of states alone, however many landmarks there are (structureless factors: Carlone et
al., "Eliminating conditionally independent sets in factor graphs", 2014).
"""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.checks import checked_noise, power_spectral_density
from factors.kernels import Array
from factors.stereo import StereoCamera
from factors.structureless.bracketing_states import BracketingStates, checked_times
from factors.structureless.fitted_landmarks import Landmarks, checked_measurements
from factors.structureless.multi_landmark_kernels import information_kernel, root_kernel


class StructurelessStereoFactor(gtsam.CustomFactor):
    """Stereo measurements of many landmarks at their own times, the landmarks eliminated.

    Parameters
    ----------
    measured
        (n, 3) measurements (u_left, v, disparity) in rectified pixels, n >= 2.
    times
        (n,) their times in seconds.
    landmarks
        (n,) integers: measurements of equal ones are of the same landmark. A landmark that is
        measured once tells nothing.
    model, states, camera, qc
        As of `TrackletFactor`.

    Raises
    ------
    ValueError
        If an argument has another shape or is not finite, times lie outside the states, or a
        disparity is not positive.

    Notes
    -----
    Its errors are 12 for each state and one more; half their squared norm is the cost of all
    measurements, and the derivative gives its exact gradient. While a landmark is behind one of the
    cameras, that measurement has GTSAM's large constant error and no derivative.
    """

    def __init__(
        self,
        measured: ArrayLike,
        times: ArrayLike,
        landmarks: ArrayLike,
        model: gtsam.noiseModel.Base,
        states: Sequence[tuple[int, int, float]],
        camera: StereoCamera,
        qc: ArrayLike | None = None,
    ) -> None:
        if qc is not None:
            power_spectral_density(qc)
        measurements = checked_measurements(measured)
        t = checked_times(times, len(measurements))
        number = np.asarray(landmarks)
        if number.shape != t.shape or number.dtype.kind not in "iu":
            raise ValueError(f"landmarks must be {len(t)} integers")
        checked_noise(model, 3)
        order = np.lexsort((t, number))
        self._numbers, start = np.unique(number[order], return_index=True)
        start = np.append(start, len(order)).astype(np.int64)
        between = BracketingStates(t[order], states)
        found = Landmarks(measurements[order], start, model, camera)
        self._tracklets = tracklets = _Tracklets(between, found)
        unit = gtsam.noiseModel.Unit.Create(tracklets.size)
        super().__init__(unit, between.keys, tracklets.error)

    def landmarks(self, values: gtsam.Values) -> tuple[NDArray[np.int64], Array]:
        """(L,) increasing landmarks, and the (L, 3) points in the world that fit them best.

        One whose rays diverge fits best beyond infinity: a point behind the cameras.
        """
        between, found = self._tracklets.between, self._tracklets.landmarks
        return self._numbers, found.points(between.poses(*between.read(values)))


class _Tracklets:
    """What the factor knows, in order of landmarks and times, and its error."""

    def __init__(self, between: BracketingStates, landmarks: Landmarks) -> None:
        self.between, self.landmarks = between, landmarks
        self.size = 12 * len(between.states) + 1
        self._linearized = np.empty(0), np.empty(0), np.empty(0)

    def error(
        self, _this: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
    ) -> Array:
        """(12 m + 1,) errors, and their derivatives by each pose and velocity if asked."""
        T_states, v_states = self.between.read(values)
        if jacobians is None:
            distances = self.landmarks.fit(self.between.poses(T_states, v_states))[1]
            error = np.zeros(self.size)
            error[-1] = np.sqrt(2 * self.landmarks.loss.total(distances))
            return error
        # iSAM2 linearizes a new factor twice at the same values.
        same = np.array_equal(T_states, self._linearized[0])
        if not (same and np.array_equal(v_states, self._linearized[1])):
            self._linearized = T_states, v_states, self._root(T_states, v_states)
        root = self._linearized[2]
        for block in range(2 * len(self.between.states)):
            jacobians[block] = root[:, 6 * block : 6 * block + 6]
        return root[:, -1]

    def _root(self, T_states: Array, v_states: Array) -> Array:
        """(12 m + 1, 12 m + 1) derivatives by the states, then the errors."""
        between, found = self.between, self.landmarks
        T = between.poses(T_states, v_states)
        coordinates, distances = found.fit(T)
        weights = found.loss.weights(distances)
        at = T_states, v_states, between.first, between.a, between.b, T
        of = coordinates, *found.measurements, weights
        H, explained = information_kernel(*at, *of)
        return root_kernel(H - explained, np.sqrt(np.diag(H)))
