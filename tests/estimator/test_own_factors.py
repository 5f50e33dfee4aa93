"""Factors of users' own in GTSAM's smoother: good ones count, a bad one is dropped alone."""

from __future__ import annotations

from collections.abc import Callable

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, V, X
from runs import PERIOD, regular
from synthetic import CAMERA, tracklets

from gpvo import FixedLagSmoother
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.trajectory import Trajectory

ADDED = 3
"""Cluster after which factors are added."""


def smoother_with(
    *factors: gtsam.NonlinearFactor, clusters: int = 9, interval: float = 0.025
) -> FixedLagSmoother:
    """A smoother that got factors of the newest state's after some clusters."""
    config = EstimatorConfig(window=3, state_interval=interval)
    smoother = FixedLagSmoother(CAMERA, NoiseConfig(), config)
    for number, (end_time, part) in enumerate(regular(tracklets(clusters, noise=0.3))):
        smoother.update(end_time, part)
        if number == ADDED:
            smoother.add(*factors)
    return smoother


def trajectory_of(smoother: FixedLagSmoother) -> Trajectory:
    trajectory = smoother.trajectory()
    assert trajectory is not None
    return trajectory


def newest(interval: float = 0.025) -> tuple[int, float, np.ndarray]:
    """Number, time and position of the newest state when factors are added."""
    plain = smoother_with(clusters=ADDED + 1, interval=interval)
    t = float(plain.window_times[-1])
    return plain.window[-1], t, trajectory_of(plain).pose(t)[:3, 3]


def position_factor(interval: float = 0.025) -> tuple[gtsam.NonlinearFactor, float, np.ndarray]:
    """GPS of the newest state, 5 cm aside of where it is: factor, time, position."""
    number, t, position = newest(interval)
    aside = position + np.array([0.05, 0.0, 0.0])
    model = gtsam.noiseModel.Isotropic.Sigma(3, 1e-4)
    return gtsam.GPSFactor(X(number), aside, model), t, aside


@pytest.mark.parametrize("interval", [0.0, 0.025])
def test_a_factor_counts_while_in_the_window_and_after(interval: float) -> None:
    gps, t, aside = position_factor(interval)
    for clusters in (5, 9):
        smoother = smoother_with(gps, clusters=clusters, interval=interval)
        assert np.abs(trajectory_of(smoother).pose(t)[:3, 3] - aside).max() < 2e-3
        assert not smoother.diagnostics


def test_a_factor_between_states_that_leave_at_different_times_counts() -> None:
    """It is left out of what landmarks know alone."""
    number, _, _ = newest()
    still = gtsam.PriorFactorVector(V(number), np.zeros(6), gtsam.noiseModel.Isotropic.Sigma(6, 1))
    model = gtsam.noiseModel.Isotropic.Sigma(6, 1e-5)
    same = gtsam.BetweenFactorPose3(X(number - 3), X(number), gtsam.Pose3(), model)
    smoother = smoother_with(still, same)
    t = number * 0.025, (number - 3) * 0.025
    positions = [trajectory_of(smoother).pose(x)[:3, 3] for x in t]
    plain = [trajectory_of(smoother_with()).pose(x)[:3, 3] for x in t]
    assert not smoother.diagnostics
    moved, without = (np.linalg.norm(a - b) for a, b in (positions, plain))
    assert moved < 0.2 * without


def raising(*_: object) -> np.ndarray:
    raise ValueError("the wheel has come off")


def not_a_number(
    _this: object, _values: gtsam.Values, jacobians: list[np.ndarray] | None
) -> np.ndarray:
    if jacobians is not None:
        jacobians[0] = np.zeros((1, 6))
    return np.full(1, np.nan)


def of_a_missing_state(_: int) -> gtsam.NonlinearFactor:
    return gtsam.PriorFactorVector(V(999), np.zeros(6), gtsam.noiseModel.Unit.Create(6))


def of_a_missing_landmark(number: int) -> gtsam.NonlinearFactor:
    model = gtsam.noiseModel.Unit.Create(2)
    return gtsam.GenericProjectionFactorCal3_S2(
        np.zeros(2), model, X(number), L(7), gtsam.Cal3_S2()
    )


def custom(error: Callable[..., np.ndarray]) -> Callable[[int], gtsam.NonlinearFactor]:
    model = gtsam.noiseModel.Unit.Create(1)
    return lambda number: gtsam.CustomFactor(model, [X(number)], error)


BAD = {
    "raises": (custom(raising), "wheel has come off", None),
    "not a number": (custom(not_a_number), "not finite", None),
    "missing state": (of_a_missing_state, "not in the window", "v999"),
    "missing landmark": (of_a_missing_landmark, "not in the window", "l7"),
}


@pytest.mark.parametrize("fault", BAD)
def test_one_that_is_bad_is_dropped_alone_and_named(fault: str) -> None:
    """With GTSAM's message; those that are good stay, and the rest is as without it."""
    make, message, key = BAD[fault]
    gps, t, aside = position_factor()
    number, _, _ = newest()
    smoother, plain = smoother_with(gps, make(number), gps), smoother_with(gps, gps)
    (found,) = smoother.diagnostics
    assert message in found.reason and "own" in found.reason
    assert found.key == (key or f"x{number}") and found.measurement is None
    assert found.t == pytest.approx((ADDED + 2) * PERIOD)
    ours, theirs = trajectory_of(smoother), trajectory_of(plain)
    assert np.array_equal(ours.T_world_cam, theirs.T_world_cam)
    assert np.abs(ours.pose(t)[:3, 3] - aside).max() < 2e-3


def test_one_that_goes_bad_in_the_window_is_dropped_alone_and_named() -> None:
    """It worked when it was added, and raises from some update on."""
    calls: list[int] = []

    def error(
        _this: gtsam.CustomFactor, _values: gtsam.Values, jacobians: list[np.ndarray] | None
    ) -> np.ndarray:
        calls.append(1)
        if len(calls) > 4:
            raise ValueError("the wheel has come off")
        if jacobians is not None:
            jacobians[0] = np.zeros((1, 6))
        return np.zeros(1)

    gps, t, aside = position_factor()
    number, _, _ = newest()
    smoother = smoother_with(gps, custom(error)(number))
    dropped = [d for d in smoother.diagnostics if "own" in d.reason]
    assert len(dropped) == 1 and "wheel has come off" in dropped[0].reason
    assert dropped[0].key == f"x{number}"
    found = trajectory_of(smoother)
    assert np.abs(found.pose(t)[:3, 3] - aside).max() < 2e-3
    assert found.stop == pytest.approx(9 * PERIOD)


def test_factors_before_the_first_measurement_wait_or_are_listed() -> None:
    smoother = FixedLagSmoother(CAMERA)
    smoother.add(of_a_missing_state(0))
    parts = tracklets(clusters=3, noise=0.3)
    for end_time, part in regular(parts):
        smoother.update(end_time, part)
    assert [found.key for found in smoother.diagnostics] == ["v999"]
