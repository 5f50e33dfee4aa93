"""Learn the noise parameters from a motion that is known: maximum likelihood.

Q_c from the accelerations of the ground truth, R from the errors of the tracklets' measurements
around landmarks that are fitted to them along the true motion.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from factors import StereoCamera
from factors.lie import se3_inverse, se3_log
from gpvo.config.stages import EstimatorConfig, NoiseConfig
from gpvo.config.stages.estimator import LEAST_NOISE, MOST_NOISE
from gpvo.errors import InputError
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import NumberedStates
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
CAUCHY_SCALE = 3.0
"""Standard deviations beyond which a measurement pulls less on its landmark."""
INLIERS = 0.999
"""Share of measurements without gross errors that are counted."""
ITERATIONS = 10
"""Fits of the landmarks with the information learned so far; the first has the paper's."""


def check_count(t: Array) -> None:
    """Raise InputError if there are less than three poses."""
    if len(t) < 3:
        raise InputError(f"{len(t)} poses: the ground truth needs three or more to tell Q_c")


def acceleration_psd(t: Array, T_world_cam: Array) -> Array:
    """(6,) power spectral density of the acceleration that makes true poses most probable.

    Two steps of a true motion in a row differ by the integral of its acceleration, and for white
    noise of density q the variance of that difference is 2 q dt^3 / 3 (WNOA, equation (prior_cov)).

    Parameters
    ----------
    t
        (N,) increasing times, seconds, N >= 3.
    T_world_cam
        (N, 4, 4) poses; their noise must be far below the motion between two of them.

    Raises
    ------
    InputError
        If there are less than three poses.
    """
    check_count(t)
    dt = np.diff(t)
    # The mean velocities of neighbouring steps differ by noise of the variance q (dt1 + dt2) / 3.
    change = np.diff(_mean_twists(t, T_world_cam), axis=0)
    density = np.mean(3 * change**2 / (dt[:-1] + dt[1:])[:, None], axis=0)
    return np.asarray(density, np.float64)


def measurement_information(
    measurements: Measurements, motion: States, camera: StereoCamera
) -> Array:
    """(3,) inverse variances of (u_left, v, disparity), pixel^-2, most probable for true poses.

    Each landmark is fitted to its measurements along the motion. n measurements leave 3 n - 3
    degrees of freedom. Gross errors are left out.

    Parameters
    ----------
    measurements
        Of landmarks; those measured less than three times are left out.
    motion
        True states, whose interpolation is the motion.
    camera
        Intrinsics of the rectified pair.

    Raises
    ------
    InputError
        If no landmark is measured three times within the motion.
    """
    measurements = _often_measured(measurements, motion)
    if len(measurements) == 0:
        raise InputError(
            "no landmark is measured three times during the ground truth; give a longer one"
        )
    share = 1 - len(np.unique(measurements.landmark)) / len(measurements)
    information = np.array(NoiseConfig().measurement_information)
    for _ in range(ITERATIONS):
        error = _residuals(measurements, motion, camera, information)
        square = error**2 @ information
        weight = 1.0 * (square < chi2.ppf(INLIERS, 3))
        learned = share * weight.sum() / np.sum(weight[:, None] * error**2, axis=0)
        information = np.clip(learned, LEAST_NOISE, MOST_NOISE)
    return information


def tuned_noise(
    clusters: Iterable[Measurements], motion: States, camera: StereoCamera
) -> NoiseConfig:
    """Noise parameters learned from the measurements of clusters and the true motion."""
    measurements = Measurements.concatenate(clusters)
    information = measurement_information(measurements, motion, camera)
    # A motion in a plane has no acceleration out of it.
    density = np.clip(acceleration_psd(motion.t, motion.T_world_cam), LEAST_NOISE, MOST_NOISE)
    return NoiseConfig(
        acceleration_psd=tuple(density.tolist()),
        measurement_information=tuple(information.tolist()),
    )


def states_of_poses(t: Array, T_world_cam: Array) -> States:
    """States at true poses; the twists are those of the steps around them."""
    step = _mean_twists(t, T_world_cam)
    twist = np.concatenate([step[:1], 0.5 * (step[:-1] + step[1:]), step[-1:]])
    return States(t, T_world_cam, twist)


def _mean_twists(t: Array, T_world_cam: Array) -> Array:
    """(N - 1, 6) mean body twists of the steps between N poses, rad/s and m/s."""
    return se3_log(se3_inverse(T_world_cam[:-1]) @ T_world_cam[1:]) / np.diff(t)[:, None]


def _often_measured(measurements: Measurements, motion: States) -> Measurements:
    inside = (measurements.t >= motion.t[0]) & (measurements.t <= motion.t[-1])
    measurements = measurements[inside]
    number, count = np.unique(measurements.landmark, return_counts=True)
    measurements = measurements[np.isin(measurements.landmark, number[count >= 3])]
    return measurements[np.argsort(measurements.t, kind="stable")]


def _residuals(
    measurements: Measurements, motion: States, camera: StereoCamera, information: Array
) -> Array:
    """(N, 3) errors of the measurements from the landmarks that fit them best, pixels.

    They are those of measurements of the deviation one.
    """
    noise = NoiseConfig(measurement_information=tuple(information.tolist()))
    robust = EstimatorConfig(loss="cauchy", loss_scale=CAUCHY_SCALE, state_interval=1.0)
    states = NumberedStates(0, motion)
    build = GraphBuilder(camera, noise, robust)
    factor = build.structureless(states.numbers, motion.t, measurements)
    return np.asarray(factor.residuals(states.values()) / measurements.deviations)
