"""Small graphs to test factors with, and numerical derivatives of factors."""

from __future__ import annotations

from collections.abc import Callable

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from hypothesis import strategies as st
from numpy.typing import NDArray

from factors import StereoCamera, interpolate
from factors.lie import se3_exp

Array = NDArray[np.float64]

CAMERA = StereoCamera(226.0, 226.0, 173.0, 130.0, 0.1)
QC = np.array([0.02, 0.02, 0.02, 0.002, 0.002, 0.002])
NOISE = gtsam.noiseModel.Diagonal.Sigmas(np.array([1.4, 1.4, 3.2]))

seeds = st.integers(0, 2**32 - 1)
durations = st.floats(-6.0, -0.5).map(lambda exponent: float(10.0**exponent))


def random_states(seed: int, dt: float, count: int = 2) -> gtsam.Values:
    """States X(k), V(k), dt apart, that move at about 1 rad/s and 1 m/s, and a landmark L(0)."""
    rng = np.random.default_rng(seed)
    values = gtsam.Values()
    T = se3_exp(rng.normal(size=6))
    for k in range(count):
        velocity = rng.normal(size=6)
        values.insert(X(k), gtsam.Pose3(T))
        values.insert(V(k), velocity)
        T = T @ se3_exp(dt * (velocity + rng.normal(size=6)))
    in_camera = np.array([*rng.uniform(-1, 1, 2), rng.uniform(2, 6), 1.0])
    values.insert(L(0), values.atPose3(X(0)).matrix()[:3] @ in_camera)
    return values


def state(values: gtsam.Values, k: int) -> tuple[Array, Array]:
    """Pose (4, 4) and velocity (6,) of state k."""
    return values.atPose3(X(k)).matrix(), values.atVector(V(k))


def pose_between(values: gtsam.Values, t_i: float, t_j: float, t: Array | float) -> Array:
    """Poses (..., 4, 4) at times t between states 0 at t_i and 1 at t_j."""
    T_i, T_j = values.atPose3(X(0)).matrix(), values.atPose3(X(1)).matrix()
    return interpolate(T_i, values.atVector(V(0)), T_j, values.atVector(V(1)), t_i, t_j, t).pose


def derivative(
    function: Callable[[gtsam.Values], Array], values: gtsam.Values, key: int, step: float
) -> Array:
    """Numerical derivative by a variable of the values, to the sixth order in the step."""
    size = len(values.zeroVectors().at(key))

    def at(i: int, h: float) -> Array:
        delta = gtsam.VectorValues()
        change = np.zeros(size)
        change[i] = h
        delta.insert(key, change)
        return np.asarray(function(values.retract(delta)))

    columns = []
    for i in range(size):
        near, far, farther = ((at(i, h) - at(i, -h)) / (2 * h) for h in (step, 2 * step, 4 * step))
        columns.append((64 * near - 20 * far + farther) / 45)
    return np.stack(columns, axis=-1)


def assert_derivatives_match(
    factor: gtsam.NonlinearFactor, values: gtsam.Values, step: float = 1e-3, tolerance: float = 1e-7
) -> None:
    """The factor's linearisation is the derivative of its whitened error."""
    A, b = factor.linearize(values).jacobian()
    numerical = [
        derivative(factor.whitenedError, values, key, step) for key in tuple(factor.keys())
    ]
    np.testing.assert_allclose(A, np.hstack(numerical), rtol=0, atol=tolerance * np.abs(A).max())
    np.testing.assert_allclose(b, -factor.whitenedError(values), rtol=1e-12, atol=1e-12)
