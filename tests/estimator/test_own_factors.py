"""Factors of users' own in GTSAM's smoother: good ones count, a bad one is dropped alone."""

from __future__ import annotations

from collections.abc import Callable

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, V, X
from runs import PERIOD, regular
from synthetic import CAMERA, constant_velocity, tracklets

from factors.lie import se3_exp
from gpvo import FixedLagSmoother, InitialState, Measurements
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


def divides(*_: object) -> np.ndarray:
    raise ZeroDivisionError("the wheel does not turn")


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
    "raises what it likes": (custom(divides), "wheel does not turn", None),
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


@pytest.mark.parametrize("kind", [ValueError, ZeroDivisionError])
def test_one_that_goes_bad_in_the_window_is_dropped_alone_and_named(kind: type[Exception]) -> None:
    """It worked when it was added, and raises from some update on."""
    calls: list[int] = []

    def error(
        _this: gtsam.CustomFactor, _values: gtsam.Values, jacobians: list[np.ndarray] | None
    ) -> np.ndarray:
        calls.append(1)
        if len(calls) > 4:
            raise kind("the wheel has come off")
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


# A world of one's own, and factors at their own times.

START = float(tracklets(9, noise=0.3)[0].t.min())
ENU = se3_exp([0.3, -0.2, 1.1, 150.0, -80.0, 20.0])
"""Pose of the first camera in a world of GPS, 170 m from its origin."""


def gps_at(t: float, sigma: float = 1e-3) -> gtsam.GPSFactor:
    """A position at any time, in that world."""
    position = (ENU @ constant_velocity(np.array([t]))[0])[:3, 3]
    return gtsam.GPSFactor(0, position, gtsam.noiseModel.Isotropic.Sigma(3, sigma))


def initial_state(off: float = 0.0) -> InitialState:
    """Known to a degree and half a metre and off by as many of these, or else known well."""
    deviations = np.repeat([0.02, 0.5, 0.3, 0.3] if off else [1e-3, 1e-2, 1, 1], 3)
    wrong = off * np.r_[deviations[:6]] * [1, -1, 1, 1, 1, -1]
    start = constant_velocity(np.array([START]))[0]
    return InitialState(ENU @ start @ se3_exp(wrong), np.zeros(6), np.diag(deviations**2))


def in_enu(initial: InitialState | None, times: list[float]) -> FixedLagSmoother:
    config = EstimatorConfig(window=3, state_interval=0.025)
    smoother = FixedLagSmoother(CAMERA, NoiseConfig(), config, initial)
    for t in times:
        smoother.add(gps_at(t), t=t)
    for end_time, part in regular(tracklets(9, noise=0.3)):
        smoother.update(end_time, part)
    return smoother


def test_an_initial_state_is_the_world() -> None:
    """Without anything else the trajectory is that of the default world, moved to it."""
    moved, plain = in_enu(initial_state(), []), in_enu(None, [])
    assert not moved.diagnostics
    ours, theirs = trajectory_of(moved), trajectory_of(plain)
    np.testing.assert_allclose(ours.t, theirs.t)
    expected = initial_state().T_world_cam @ theirs.T_world_cam
    assert np.linalg.norm((ours.T_world_cam - expected)[:, :3, 3], axis=1).max() < 5e-3


def test_gps_at_its_own_times_in_its_own_world() -> None:
    """Times between the key states; nothing is left out, and the start is found again."""
    times = np.linspace(START + 0.013, 9 * PERIOD - 0.0171, 17).tolist()
    smoother = in_enu(initial_state(off=1.0), times)
    assert not smoother.diagnostics
    t = np.linspace(times[0], times[-1], 50)
    found = trajectory_of(smoother).pose(t)[:, :3, 3]
    truth = (ENU @ constant_velocity(t))[:, :3, 3]
    assert np.linalg.norm(found - truth, axis=1).max() < 0.02
    alone = trajectory_of(in_enu(initial_state(off=1.0), [])).pose(t)[:, :3, 3]
    assert np.linalg.norm(alone - truth, axis=1).max() > 0.3


def test_a_factor_at_a_time_before_the_window_is_named() -> None:
    smoother = in_enu(initial_state(), [])
    smoother.add(gps_at(0.01), gps_at(9 * PERIOD - 0.01), t=0.01)
    smoother.add(gps_at(9 * PERIOD - 0.01), t=9 * PERIOD - 0.01)
    smoother.add(gtsam.GPSFactor(0, np.zeros(3), gtsam.noiseModel.Unit.Create(3)), t=1e3)
    smoother.update(10 * PERIOD, Measurements.concatenate([]))
    assert [found.key for found in smoother.diagnostics] == ["t = 0.010000 s"] * 2
    assert all("before the window" in found.reason for found in smoother.diagnostics)
    smoother.add(custom(raising)(0), t=10 * PERIOD - 0.01)
    smoother.update(11 * PERIOD, Measurements.concatenate([]))
    assert "the wheel has come off" in smoother.diagnostics[-1].reason


def test_a_time_that_is_none_is_refused_at_once() -> None:
    smoother, gps = in_enu(initial_state(), []), gps_at(0.01)
    for wrong in ("soon", np.nan, [0.1]):
        with pytest.raises(ValueError, match="t must be"):
            smoother.add(gps, t=wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="velocity must be a key"):
        smoother.add(gps, t=0.1, velocity=-1)
    with pytest.raises(ValueError, match="key must be a key"):
        smoother.marginalCovariance("x0")  # type: ignore[arg-type]


def test_the_smoother_tells_what_it_knows() -> None:
    smoother = in_enu(initial_state(), [0.2, 0.4])
    values, newest = smoother.calculateEstimate(), smoother.window[-1]
    states, covariance = smoother.states, trajectory_of(smoother).covariance(9 * PERIOD)
    np.testing.assert_allclose(values.atPose3(X(newest)).matrix(), states.T_world_cam[-1])
    np.testing.assert_allclose(values.atVector(V(newest)), states.twist[-1])
    for key, part in ((X(newest), slice(0, 6)), (V(newest), slice(6, 12))):
        expected = covariance[part, part]
        np.testing.assert_allclose(smoother.marginalCovariance(key), expected, rtol=1e-6, atol=1e-9)
    with pytest.raises(ValueError, match="x999 is not in the window"):
        smoother.marginalCovariance(X(999))
    number, points = smoother.landmarks
    assert len(number) == len(points) > 10
    T_cam_world = np.linalg.inv(states.T_world_cam[-1])
    assert (points @ T_cam_world[2, :3] + T_cam_world[2, 3] > 0.5).all()
    graph = smoother.graph
    keys = {key for i in range(graph.size()) for key in tuple(graph.at(i).keys())}
    assert keys <= set(values.keys())
    assert np.isfinite(graph.error(values))


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("T_world_cam", {"T_world_cam": 2 * np.eye(4)}),
        ("twist", {"twist": np.zeros(3)}),
        ("covariance", {"covariance": np.eye(6)}),
        ("covariance", {"covariance": -np.eye(12)}),
    ],
)
def test_a_bad_initial_state_is_refused(name: str, change: dict[str, np.ndarray]) -> None:
    good = {"T_world_cam": np.eye(4), "twist": np.zeros(6), "covariance": np.eye(12)}
    with pytest.raises(ValueError, match=name):
        InitialState(**{**good, **change})


def test_only_the_factor_that_makes_the_window_indeterminate_is_left_out() -> None:
    """It is finite by itself, and its information is more than the others' can hold."""
    number, _, _ = newest()
    gps, t, aside = position_factor()
    huge = 1e200 * np.eye(6)

    def error(
        _this: object, _values: gtsam.Values, jacobians: list[np.ndarray] | None
    ) -> np.ndarray:
        if jacobians is not None:
            jacobians[0] = huge
        return np.zeros(6)

    wrecking = gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(6), [V(number)], error)
    smoother = smoother_with(gps, wrecking)
    own = [found for found in smoother.diagnostics if "of your own" in found.reason]
    assert [found.key for found in own] == [f"v{number}"]
    assert np.abs(trajectory_of(smoother).pose(t)[:3, 3] - aside).max() < 2e-3
