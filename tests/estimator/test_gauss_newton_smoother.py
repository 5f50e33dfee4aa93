"""The fixed-lag smoother against GTSAM, closed forms, and the truth of simulated runs."""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gpvo.estimator.gauss_newton_smoother import GaussNewtonSmoother
from gpvo.estimator.gaussian import IndeterminateError, Quadratic
from gpvo.estimator.lag_window import LagWindow, Sensor, new_times
from gpvo.estimator.marginal_prior import MarginalPrior
from gpvo.estimator.robust import RobustLoss
from gpvo.estimator.unique_times import bridge_covariance
from gpvo.estimator.window_cost import Columns, Variables, WindowCost
from gtsam.symbol_shorthand import L, V, X
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import CAMERA, TWIST, constant_velocity, tracklets
from test_estimators import PERIOD, estimate
from test_robustness import behind_the_camera, outliers, run

from factors import InterpolatedStereoFactor, WnoaPriorFactor, wnoa_covariance
from factors.lie import se3_inverse, se3_log
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.evaluation.metrics.nees import mean_nees_interval, nees
from gpvo.simulation.tracklets import TrackletSimulation
from gpvo.tracking import Measurements
from gpvo.trajectory import States

NOISE = NoiseConfig()
ANCHOR = np.diag(np.repeat([1e-3, 1.0], 6) ** 2)


def window_cost(unique: bool = False) -> tuple[WindowCost, Variables]:
    """A cost and variables that are near its minimum."""
    rng = np.random.default_rng(3)
    measurements = Measurements.concatenate(tracklets(clusters=3, per_cluster=4, noise=0.3))
    measurements = measurements[np.argsort(measurements.t)]
    t = np.linspace(0, 0.15, 5)
    twist = np.tile(TWIST, (5, 1)) + 0.02 * rng.standard_normal((5, 6))
    states = States(t, constant_velocity(t), twist)
    sensor = Sensor(CAMERA, NOISE, EstimatorConfig())
    window = replace(LagWindow.of_state(sensor, states[:1], ANCHOR), states=states)
    window, _ = window.measured(measurements)
    known = np.isin(measurements.landmark, window.landmarks.number)
    prior = MarginalPrior.of_state(states.T_world_cam[0], states.twist[0], ANCHOR)
    cost = WindowCost(CAMERA, NOISE, RobustLoss(), prior, measurements[known], unique)
    return cost, Variables(states, window.landmarks)


def gtsam_graph(cost: WindowCost, states: States) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    for k in range(len(states) - 1):
        dt = states.t[k + 1] - states.t[k]
        graph.push_back(WnoaPriorFactor(X(k), V(k), X(k + 1), V(k + 1), dt, NOISE.acceleration_psd))
    model = gtsam.noiseModel.Gaussian.Information(np.diag(NOISE.measurement_information))
    for n in range(len(cost.measurements)):
        t = cost.measurements.t[n]
        k = min(int(np.searchsorted(states.t, t, "right")) - 1, len(states) - 2)
        keys = (X(k), V(k), X(k + 1), V(k + 1), L(int(cost.measurements.landmark[n])))
        times = (states.t[k], states.t[k + 1], t)
        stereo = cost.measurements.stereo[n]
        graph.push_back(InterpolatedStereoFactor(stereo, model, *keys, CAMERA, *times))
    return graph


def test_cost_is_that_of_the_factors() -> None:
    cost, variables = window_cost()
    values = gtsam.Values()
    states = variables.states
    for k in range(len(states)):
        values.insert(X(k), gtsam.Pose3(states.T_world_cam[k]))
        values.insert(V(k), states.twist[k])
    for number, point in zip(
        variables.landmarks.number.tolist(), variables.landmarks.points(), strict=True
    ):
        values.insert(L(number), point)
    expected = 2 * gtsam_graph(cost, states).error(values)
    assert cost.value(variables) == pytest.approx(expected, rel=1e-9)


def test_gradient_is_the_derivative_of_the_cost() -> None:
    cost, variables = window_cost()
    quadratic = cost.quadratic(variables)
    assert quadratic.c == pytest.approx(cost.value(variables))
    rng = np.random.default_rng(0)
    scale = 1 / np.sqrt(np.diagonal(quadratic.H))
    for _ in range(10):
        step = 1e-4 * scale * rng.standard_normal(len(scale))
        change = cost.value(variables.moved(step)) - cost.value(variables.moved(-step))
        assert change == pytest.approx(4 * quadratic.g @ step, rel=1e-4, abs=1e-7)


@pytest.mark.parametrize("unique", [False, True])
def test_information_is_that_of_the_stacked_derivatives(unique: bool) -> None:
    """The kernels against one dense Jacobian, and the deviations' covariance of the formula."""
    cost, variables = window_cost(unique)
    quadratic = cost.quadratic(variables)
    rows, by_local = cost.stereo(variables)
    J = np.zeros((len(rows), 3, len(quadratic.g)))
    np.put_along_axis(J, np.repeat(cost.columns(variables)[:, None], 3, 1), rows[..., :-1], 2)
    W = np.eye(3 * len(rows))
    if unique:
        t, time = variables.states.t, cost.measurements.t
        before = np.searchsorted(t, time, "right") - 1
        for k in np.unique(before):
            n = np.flatnonzero(before == k)
            spread = bridge_covariance(time[n] - t[k], t[k + 1] - t[k])[0, 0]
            own = np.einsum("nri,i,msi->nrms", by_local[n], NOISE.acceleration_psd, by_local[n])
            columns = (3 * n[:, None] + np.arange(3)).ravel()
            correlated = (own * spread[:, None, :, None]).reshape(len(columns), len(columns))
            W[np.ix_(columns, columns)] += correlated
    J, e = J.reshape(len(W), -1), rows[..., -1].ravel()
    nothing = replace(cost, measurements=cost.measurements[:0]).quadratic(variables)
    H = nothing.H + J.T @ np.linalg.solve(W, J)
    scale = np.sqrt(np.diagonal(H))
    assert np.abs(np.triu(quadratic.H - H) / np.outer(scale, scale)).max() < 1e-12
    g = nothing.g + J.T @ np.linalg.solve(W, e)
    assert np.allclose(quadratic.g, g, atol=1e-9 * np.abs(g).max())


def test_any_order_of_the_columns_is_the_same_information() -> None:
    cost, variables = window_cost()
    natural, columns = cost.quadratic(variables), variables.columns
    states, landmarks = len(variables.states), len(variables.landmarks)
    last = Columns(12 * np.arange(states), 12 * states + 3 * np.arange(landmarks))
    other = cost.quadratic(variables, last)
    order = np.concatenate([np.arange(12 * states) + 3 * landmarks, np.arange(3 * landmarks)])
    assert columns.size == last.size == len(order)
    H = np.triu(natural.H) + np.triu(natural.H, 1).T
    assert np.allclose(np.triu(other.H), np.triu(H[np.ix_(order, order)]), rtol=1e-12)
    assert np.allclose(other.g, natural.g[order], rtol=1e-12)


def test_minimum_and_covariance_of_a_quadratic_and_its_marginal() -> None:
    rng = np.random.default_rng(0)
    root = rng.standard_normal((9, 6)) * [1e6, 1, 1e-4, 1, 1, 1]
    quadratic = Quadratic(root.T @ root, root.T @ rng.standard_normal(9), 3.0)
    d = quadratic.minimum()
    assert np.allclose(quadratic.H @ d, -quadratic.g)
    covariance = quadratic.covariance(np.arange(6))
    scale = np.sqrt(np.diagonal(quadratic.H))
    identity = (covariance @ quadratic.H) * scale[:, None] / scale
    assert np.allclose(identity, np.eye(6), atol=1e-6)
    marginal = quadratic.marginal(2)
    assert np.allclose(marginal.minimum(), d[2:])
    assert np.allclose(marginal.covariance(np.arange(4)), covariance[2:, 2:])
    assert marginal.cost(d[2:]) == pytest.approx(quadratic.cost(d))


def test_what_is_not_determined_is_named() -> None:
    H = np.diag([1.0, 1.0, 0.0])
    with pytest.raises(IndeterminateError) as error:
        Quadratic(H, np.zeros(3)).minimum()
    assert error.value.column == 2
    H = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    with pytest.raises(IndeterminateError) as error:
        Quadratic(H, np.zeros(3)).minimum()
    assert error.value.column == 1


@pytest.mark.parametrize("name", ["none", "huber", "cauchy", "gnc"])
def test_weight_is_the_derivative_of_the_loss(name: str) -> None:
    loss, s = RobustLoss(name, 3.0, 2.0), np.array([0.1, 1.0, 8.0, 30.0, 400.0])  # type: ignore[arg-type]
    h = 1e-5
    assert np.allclose((loss.cost(s + h) - loss.cost(s - h)) / (2 * h), loss.weight(s), rtol=1e-6)


def test_bridge_is_the_chain_given_its_ends() -> None:
    """Against the covariance of an explicit chain of states, conditioned on the last."""
    times, end = np.array([0.004, 0.0041, 0.013]), 0.02
    dt = np.diff(np.concatenate([[0.0], times, [end]]))
    one = np.ones(6)
    covariance = np.zeros((8, 8))
    for i in range(4):
        Q = wnoa_covariance(dt[i], one)[::6, ::6]
        phi = np.array([[1, dt[i]], [0, 1]])
        now = slice(2 * i, 2 * i + 2)
        if i:
            past = slice(0, 2 * i)
            covariance[now, past] = phi @ covariance[now.start - 2 : now.start, past]
            covariance[past, now] = covariance[now, past].T
            Q = Q + phi @ covariance[now.start - 2 : now.start, now.start - 2 : now.start] @ phi.T
        covariance[now, now] = Q
    mixed = covariance[:6, 6:]
    given_end = covariance[:6, :6] - mixed @ np.linalg.inv(covariance[6:, 6:]) @ mixed.T
    ours = bridge_covariance(times, end).transpose(2, 0, 3, 1).reshape(6, 6)
    scale = np.sqrt(np.diagonal(given_end))
    assert np.abs((ours - given_end) / np.outer(scale, scale)).max() < 1e-9


def test_eliminated_unique_times_are_states_of_the_whole_graph() -> None:
    measurements = tracklets(clusters=4, noise=0.3)
    settings = {"state_interval": 0, "window": 10, "relative_decrease": 1e-9}
    weak = NoiseConfig(initial_velocity=1e3)  # the batch window moves its prior on
    ours = estimate(measurements, weak, method="gauss_newton", **settings)
    theirs = estimate(measurements, weak, method="batch", **settings)
    t = theirs.t[1:]
    assert np.isin(t, ours.t).all()
    difference = se3_log(se3_inverse(theirs.pose(t)) @ ours.pose(t))
    difference = np.hstack([difference, theirs.velocity(t) - ours.velocity(t)])
    sigma = np.sqrt(np.diagonal(ours.covariance(t), 0, 1, 2))
    assert (np.abs(difference) / sigma).max() < 1e-3


def test_estimators_agree_after_measurements_have_left_the_window() -> None:
    """With all that earlier measurements told within a hundredth of a standard deviation.

    The batch window forgets it, and a landmark that is eliminated after a window is another one
    then: that is uncertainty, by which they may differ.
    """
    measurements = tracklets(clusters=9, noise=0.3)
    reference = estimate(measurements, method="gauss_newton", state_interval=0.0)
    t = np.linspace(5.5 * PERIOD, measurements[-1].t.max(), 40)
    sigma = np.sqrt(np.diagonal(reference.covariance(t), 0, 1, 2))
    for method, interval, landmarks, tolerance in [
        ("gauss_newton", 0.025, "eliminated", 0.01),
        ("fixed_lag", 0.0, "variables", 0.01),
        ("fixed_lag", 0.025, "variables", 0.01),
        ("fixed_lag", 0.025, "eliminated", 1.0),
        ("batch", 0.0, "eliminated", 1.0),
        ("batch", 0.025, "eliminated", 1.0),
    ]:
        settings = {"method": method, "state_interval": interval, "landmarks": landmarks}
        other = estimate(measurements, **settings)
        difference = se3_log(se3_inverse(reference.pose(t)) @ other.pose(t))
        difference = np.hstack([difference, reference.velocity(t) - other.velocity(t)])
        assert np.abs(difference / sigma).max() < tolerance, settings
        if method == "fixed_lag":
            assert (np.diagonal(other.covariance(t), 0, 1, 2) > 0.99 * sigma**2).all(), settings


def test_key_times_differ_from_unique_times_by_far_less_than_a_percent_of_three_sigma() -> None:
    measurements = tracklets(clusters=10, per_cluster=15, noise=1.0)
    unique, key = (estimate(measurements, state_interval=x) for x in (0.0, 0.025))
    t = np.linspace(unique.start + 0.01, unique.stop, 200)
    difference = se3_log(se3_inverse(unique.pose(t)) @ key.pose(t))
    sigma = np.sqrt(np.diagonal(unique.covariance(t), 0, 1, 2)[:, :6])
    assert (np.abs(difference) / (3 * sigma)).max() < 1e-3


@pytest.mark.parametrize("interval", [0.0, 0.025])
@pytest.mark.parametrize("method", ["gauss_newton", "fixed_lag"])
def test_final_states_join_those_of_the_window_without_jumps(method: str, interval: float) -> None:
    """What a step has beyond the mean twist is no larger over borders of the window than inside."""
    trajectory = estimate(
        tracklets(clusters=14, per_cluster=10, noise=1.0),
        method=method,
        window=4,
        state_interval=interval,
    )
    t = np.arange(trajectory.start, trajectory.stop, 0.0125)
    T, v = trajectory.pose(t), trajectory.velocity(t)
    step = se3_log(se3_inverse(T[:-1]) @ T[1:])
    jump = np.abs(step - 0.5 * np.diff(t)[:, None] * (v[:-1] + v[1:])).max(axis=1)
    border = np.min(np.abs(t[:-1, None] - PERIOD * np.arange(15)), axis=1) < 0.0125
    assert jump[border].max() < 1.1 * jump[~border].max()
    assert np.abs(np.diff(v, axis=0)).max() < 0.1


def test_a_landmark_that_cannot_be_is_dropped_and_told() -> None:
    trajectory, repairs = run(behind_the_camera())
    assert np.isfinite(trajectory.T_world_cam).all()
    dropped = [repair for repair in repairs if "landmark" in repair.reason]
    assert dropped
    for repair in dropped:
        assert repair.key.startswith("l") and repair.measurement is not None
        assert 0 <= repair.t <= trajectory.stop
        assert set(repair.to_dict()) == {"key", "t", "measurement", "reason"}


@pytest.mark.parametrize(
    "share, settings",
    [(0.5, {"loss": "cauchy"}), (0.5, {"loss": "cauchy", "gate": 0.999}), (0.2, {"loss": "gnc"})],
)
def test_outliers_hardly_matter(share: float, settings: dict) -> None:
    """The naive run need not converge, and where it ends differs between processors."""
    trajectory, repairs = run(outliers(share), **settings)
    naive, _ = run(outliers(share))
    errors = [x.velocity(x.t) - TWIST for x in (trajectory, naive)]
    rms, naive_rms = (np.sqrt(np.mean(error**2)) for error in errors)
    assert np.abs(errors[0]).max() < 0.1
    assert 3 * rms < naive_rms
    assert ("gate" in settings) == any("gate" in repair.reason for repair in repairs)


@pytest.mark.parametrize("fails", [1, 2, 3])
def test_a_failed_update_is_rolled_back_and_told(
    monkeypatch: pytest.MonkeyPatch, fails: int
) -> None:
    """However often solving fails, the trajectory goes on, and the next cluster is taken again."""
    smoother = GaussNewtonSmoother(CAMERA, NOISE, EstimatorConfig())
    parts = tracklets(clusters=9)
    solved, calls = LagWindow.solved, []

    def failing(window: LagWindow) -> object:
        calls.append(1)
        if len(calls) <= fails:
            raise IndeterminateError(0)
        return solved(window)

    for frame, part in enumerate(parts):
        if frame == 6:
            monkeypatch.setattr(LagWindow, "solved", failing)
        smoother.update(frame, (frame + 1) * PERIOD, part, None)
    trajectory = smoother.trajectory(0)
    assert trajectory is not None
    assert trajectory.stop == pytest.approx(9 * PERIOD)
    truth = constant_velocity(trajectory.t)
    error = se3_log(se3_inverse(se3_inverse(truth[0]) @ truth) @ trajectory.T_world_cam)
    assert np.abs(error).max() < 0.02
    restarts = [repair for repair in smoother.repairs if repair.key.startswith("x")]
    assert len(restarts) == fails


@settings(deadline=None, max_examples=60)
@given(
    st.floats(0, 10),
    st.lists(st.floats(0, 20), max_size=5),
    st.floats(0, 12),
    st.sampled_from([0.01, 0.025, 1.0]),
)
def test_new_times(last: float, measured: list[float], ahead: float, interval: float) -> None:
    stop = last + ahead
    seen = np.array([t for t in measured if t <= stop])
    t = new_times(last, seen, stop, interval)
    steps = np.diff(t, prepend=last)
    assert (steps > 0).all()
    if ahead > 1e-6:
        assert t[-1] == pytest.approx(stop)
        assert (steps[1:] <= interval * (1 + 1e-5)).all()


def test_covariances_are_honest() -> None:
    """Mean NEES over 24 simulated runs; the benchmark does it with a hundred."""
    runs, values = 24, []
    for seed in range(runs):
        rng, simulation = np.random.default_rng(seed), TrackletSimulation(NOISE, per_cluster=6)
        motion = simulation.motion(0.4, rng)
        smoother = GaussNewtonSmoother(simulation.camera, NOISE, EstimatorConfig(window=4))
        for frame, (stop, measurements) in enumerate(simulation.clusters(motion, rng)):
            smoother.update(frame, stop, measurements, None)
        trajectory = smoother.trajectory(0)
        assert trajectory is not None
        values.append(nees(trajectory, motion, np.array([0.15, 0.4])))
    low, high = mean_nees_interval(runs, 0.99)
    mean = np.mean(values, axis=0)
    assert ((mean > low) & (mean < high)).all(), mean
