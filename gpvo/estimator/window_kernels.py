"""Errors in a window of states and their derivatives, all its measurements at once.

The same formulas as factors.WnoaPriorFactor and
factors.InterpolatedStereoFactor, which the tests hold them to.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.local_variables import (
    EXACT,
    hermite_weights,
    interpolated_local_kernel,
    local_jacobian_kernel,
    local_state_kernel,
    retract_kernel,
    rows_by_states_kernel,
)
from factors.kernels.se3 import (
    RIGHT,
    Array,
    inner_kernel,
    jacobian_coefficients_kernel,
    kernel,
    se3_polynomial_kernel,
)
from factors.stereo import reprojection_kernel
from factors.wnoa import wnoa_kernel

Index = NDArray[np.int64]


@kernel
def errors_kernel(
    T: Array,
    twist: Array,
    t: Array,
    time: Array,
    interval: Index,
    landmark: Index,
    T_world_chart: Array,
    coordinates: Array,
    measured: Array,
    camera: Array,
    whitening: Array,
    result: Array,
) -> None:
    """Whitened errors of measurements in order of time, and the depths of their landmarks.

    The parameters are those of `stereo_kernel`; result (N, 4), written: error (3) and depth.
    """
    local_j, pose, velocity = np.empty(12), np.empty((4, 4)), np.empty(6)
    point, last = np.empty(3), -1
    for n in range(len(time)):
        i = interval[n]
        if i != last:
            local_j = local_state_kernel(T[i], T[i + 1], twist[i + 1])
            last = i
        weights = hermite_weights(time[n] - t[i], t[i + 1] - time[n])
        retract_kernel(T[i], interpolated_local_kernel(twist[i], local_j, weights), pose, velocity)
        _write_point_kernel(T_world_chart[landmark[n]], coordinates[landmark[n]], point)
        stereo = reprojection_kernel(pose, point, measured[n], camera)
        result[n, 3] = 0.0
        for m in range(3):
            result[n, m] = whitening[m] * stereo[m, 9]
            result[n, 3] += pose[m, 2] * (point[m] - pose[m, 3])


@kernel
def stereo_kernel(
    T: Array,
    twist: Array,
    t: Array,
    time: Array,
    interval: Index,
    landmark: Index,
    T_world_chart: Array,
    coordinates: Array,
    measured: Array,
    camera: Array,
    whitening: Array,
    result: Array,
    by_local: Array,
) -> None:
    """Whitened errors of measurements in order of time, and their derivatives.

    Parameters
    ----------
    T, twist, t
        (K, 4, 4), (K, 6), (K,) states.
    time, interval, landmark, measured
        (N,), (N,), (N,), (N, 3) measurements: time, number of the state before, landmark, stereo.
    T_world_chart, coordinates
        (L, 4, 4) frames of the landmarks and (L, 3) x / z, y / z and 1 / z in them.
    camera, whitening
        (5,) parameters, and (3,) inverse standard deviations.
    result
        (N, 3, 28), written: derivative by state before (12), state after (12) and coordinates (3),
        then the error.
    by_local
        (N, 3, 6), written: derivative by xi, local to the state before, at the measurement's time.
    """
    local_j, by_states_j = np.empty(12), np.empty((12, 24))
    pose, velocity, point, last = np.empty((4, 4)), np.empty(6), np.empty(3), -1
    for n in range(len(time)):
        i = interval[n]
        j = i + 1
        if i != last:
            local_j = local_state_kernel(T[i], T[j], twist[j])
            by_states_j = local_jacobian_kernel(local_j, twist[j], EXACT)
            last = i
        weights = hermite_weights(time[n] - t[i], t[j] - time[n])
        local = interpolated_local_kernel(twist[i], local_j, weights)
        retract_kernel(T[i], local, pose, velocity)
        chart, q = T_world_chart[landmark[n]], coordinates[landmark[n]]
        _write_point_kernel(chart, q, point)
        stereo = reprojection_kernel(pose, point, measured[n], camera)
        first = len(stereo) - 3
        by_states = rows_by_states_kernel(stereo, first, local, by_states_j, weights)
        jacobian = se3_polynomial_kernel(local, jacobian_coefficients_kernel(local, RIGHT))
        for r in range(3):
            result[n, r, 27] = whitening[r] * stereo[r, 9]
            for c in range(24):
                result[n, r, c] = whitening[r] * by_states[r, c]
            for c in range(6):
                value = 0.0
                for m in range(6):
                    value += stereo[r, m] * jacobian[m, c]
                by_local[n, r, c] = whitening[r] * value
            away = 0.0
            for c in range(3):
                turned = 0.0
                for m in range(3):
                    turned += stereo[r, 6 + m] * chart[m, c]
                if c < 2:
                    result[n, r, 24 + c] = whitening[r] * turned / q[2]
                    away += turned * q[c]
                else:
                    away += turned
            result[n, r, 26] = -whitening[r] * away / (q[2] * q[2])


@inner_kernel
def _write_point_kernel(chart: Array, q: Array, point: Array) -> None:
    """Write the point (3,) in the world of coordinates q (3,) in a frame (4, 4)."""
    for m in range(3):
        point[m] = (chart[m, 0] * q[0] + chart[m, 1] * q[1] + chart[m, 2]) / q[2] + chart[m, 3]


@kernel
def motion_kernel(
    T: Array, twist: Array, t: Array, whitening: Array, derivatives: bool, result: Array
) -> None:
    """Whitened WNOA errors between each state and the next: result (K - 1, 12, 25), written.

    `whitening` (6,) are the inverse roots of the power spectral density. The last column is the
    error, those before it are the derivative by both states.
    """
    for k in range(len(t) - 1):
        dt = t[k + 1] - t[k]
        raw = wnoa_kernel(T[k], twist[k], T[k + 1], twist[k + 1], dt, derivatives, EXACT)
        a, b, c = np.sqrt(12 / (dt * dt * dt)), -np.sqrt(3 / dt), np.sqrt(1 / dt)
        for r in range(6):
            for column in range(25):
                result[k, r, column] = whitening[r] * (a * raw[r, column] + b * raw[6 + r, column])
                result[k, 6 + r, column] = whitening[r] * c * raw[6 + r, column]
