"""GTSAM's fixed-lag smoother: every measurement counts once, at key times as at unique ones."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V, X
from runs import (
    NOTHING,
    PERIOD,
    POINTS,
    Cluster,
    deviation,
    errors,
    estimate,
    fed,
    regular,
)
from synthetic import CAMERA, TWIST, constant_velocity, tracklets

from benchmarks.simulated_tracklets import TrackletSimulation
from factors import LandmarkPrior, LinearStatesFactor, StructurelessStereoFactor, WnoaPriorFactor
from factors.lie import se3_inverse, se3_log
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator import FixedLagSmoother
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import GraphUpdate
from gpvo.estimator.lag_window import LagWindow
from gpvo.evaluation.metrics.nees import mean_nees_interval, nees
from gpvo.tracking import Measurements
from gpvo.trajectory import States

INTERVALS = (0.0, 0.1)


def smoother(**settings: object) -> FixedLagSmoother:
    config = EstimatorConfig.model_validate({"window": 4} | settings)
    return FixedLagSmoother(CAMERA, NoiseConfig(), config)


def seen_forever(clusters: int, count: int = 12) -> list[Measurements]:
    """Exact measurements of the same landmarks, once in every cluster."""
    rng, twist = np.random.default_rng(0), 0.3 * TWIST
    points = CAMERA.triangulate(rng.uniform([80, 80, 8], [260, 180, 25], (count, 3)))
    parts = []
    for frame in range(clusters):
        t = np.round((frame + rng.random(count)) * PERIOD, 6)
        T = constant_velocity(t, twist)
        local = np.einsum("nji,nj->ni", T[:, :3, :3], points - T[:, :3, 3])
        seen = np.arange(count), np.full(count, frame), t, CAMERA.project(local)
        parts.append(Measurements(*seen))
    return parts


def test_an_update_that_was_prepared_gives_the_same_and_what_is_known_does_not_change() -> None:
    plain, prepared = smoother(), smoother()
    for end_time, part in regular(seen_forever(12)):
        for one in (plain, prepared):
            one.update(end_time, part)
        before = prepared.trajectory()
        prepared.prepare()
        found = [each.trajectory() for each in (plain, prepared)]
        for name in ("t", "T_world_cam", "twist", "knots", "knot_covariance"):
            arrays = [getattr(each, name) for each in (before, *found)]
            np.testing.assert_array_equal(arrays[0], arrays[1])
            np.testing.assert_array_equal(arrays[0], arrays[2])
        assert plain.noise == prepared.noise


def irregular() -> list[Cluster]:
    """Landmarks that stay, gaps, a cluster without length, and measurements that come late."""
    parts = [
        Measurements.concatenate([new, replace(old, landmark=old.landmark + 500)])
        for new, old in zip(tracklets(14, per_cluster=3, noise=0.3), seen_forever(14), strict=True)
    ]
    late = parts[3][::2]
    clusters = regular([*parts[:3], parts[3][1::2], parts[4], late, *parts[5:8]])
    clusters += [(clusters[-1][0], parts[8][:0])]
    clusters += [(stop, NOTHING) for stop, _ in regular(parts)[9:12]]
    return clusters + regular(parts)[12:]


def factors_in(estimator: FixedLagSmoother) -> list[gtsam.NonlinearFactor]:
    graph = estimator._window.factors
    return [graph.at(i) for i in range(graph.size()) if graph.at(i) is not None]


def rows_of(measurements: Measurements) -> set[tuple[float, ...]]:
    return {(t, *stereo) for t, stereo in zip(measurements.t, measurements.stereo, strict=True)}


@pytest.mark.parametrize("interval", INTERVALS)
def test_no_measurement_is_in_two_factors(monkeypatch: pytest.MonkeyPatch, interval: float) -> None:
    """What was marginalised is in no factor that follows: of the measurements, or of a prior."""
    made: list[Measurements] = []
    structureless = GraphBuilder.structureless

    def spied(
        build: GraphBuilder,
        numbers: range,
        t: np.ndarray,
        measurements: Measurements,
        prior: LandmarkPrior | None = None,
    ) -> gtsam.NonlinearFactor:
        made.append(measurements)
        return structureless(build, numbers, t, measurements, prior)

    monkeypatch.setattr(GraphBuilder, "structureless", spied)
    estimator, before = smoother(state_interval=interval), set[tuple[float, ...]]()
    first, gone = -np.inf, set[tuple[float, ...]]()
    for stop, part in irregular():
        estimator.update(stop, part)
        follows = any(isinstance(f, StructurelessStereoFactor) for f in factors_in(estimator))
        now = rows_of(made[-1]) if follows else set[tuple[float, ...]]()
        if estimator.window_times[0] > first:
            first = estimator.window_times[0]
            gone |= {row for row in before if row[0] < first}
        assert now.isdisjoint(gone)
        assert all(row[0] >= first for row in now)
        before = now
    assert len(gone) > 100
    assert not estimator.diagnostics


def check_graph(estimator: FixedLagSmoother, first: int) -> tuple[int, list[int]]:
    """Count the structureless factors, and list each GPS factor's state; others are checked.

    There are priors on the state `first`, or a linear factor of what was marginalised, and one
    WNOA prior between two states each.
    """
    window, factors = estimator.window, factors_in(estimator)
    inside = {key(k) for k in window for key in (X, V)}
    assert all(inside.issuperset(factor.keys()) for factor in factors)
    kinds = Counter(type(factor).__name__ for factor in factors)
    at_start = kinds["PriorFactorPose3"], kinds["PriorFactorVector"], kinds["LinearContainerFactor"]
    assert at_start == ((1, 1, 0) if window[0] == first else (0, 0, 1))
    pairs = [frozenset([X(k), V(k), X(k + 1), V(k + 1)]) for k in window[:-1]]
    motion = [frozenset(f.keys()) for f in factors if type(f) is WnoaPriorFactor]
    assert Counter(motion) == Counter(pairs)
    count = sum(isinstance(f, StructurelessStereoFactor) for f in factors)
    gps = [gtsam.symbolIndex(f.keys()[0]) for f in factors if isinstance(f, gtsam.GPSFactor)]
    linear = sum(isinstance(f, LinearStatesFactor) for f in factors)
    assert linear == 0  # it is marginalised with the states that leave
    assert len(factors) == sum(at_start) + len(motion) + count + len(gps)
    return count, sorted(gps)


@pytest.mark.parametrize("interval", INTERVALS)
@pytest.mark.parametrize("fails_at", [None, 7])
def test_a_factor_that_is_replaced_takes_no_other_one_with_it(
    monkeypatch: pytest.MonkeyPatch, fails_at: int | None, interval: float
) -> None:
    """After every update, also when the window was solved again because one failed."""
    update, failed = LagWindow.solve, list[int]()

    def failing(window: LagWindow, added: GraphUpdate) -> States:
        if number == fails_at and not failed:
            failed.append(number)
            raise RuntimeError("indeterminate")
        return update(window, added)

    monkeypatch.setattr(LagWindow, "solve", failing)
    estimator, model = smoother(state_interval=interval), gtsam.noiseModel.Isotropic.Sigma(3, 1.0)
    added: list[int] = []
    replaced = first = 0
    for number, (stop, part) in enumerate(irregular()):  # noqa: B007
        diagnostics = len(estimator.diagnostics)
        estimator.update(stop, part)
        if len(estimator.diagnostics) > diagnostics:
            first = estimator.window[0]
        count, gps = check_graph(estimator, first)
        assert count <= 1
        replaced += count
        assert gps == [state for state in added if state >= estimator.window[0]]
        added.append(estimator.window[-1])
        estimator.add(gtsam.GPSFactor(X(added[-1]), np.zeros(3), model))
    assert replaced > 8
    assert bool(estimator.diagnostics) == (fails_at is not None)


@pytest.mark.parametrize("fails", [1, 2, 3])
@pytest.mark.parametrize("interval", INTERVALS)
def test_a_failed_update_is_solved_again_and_listed(
    monkeypatch: pytest.MonkeyPatch, fails: int, interval: float
) -> None:
    """However often solving fails, the trajectory goes on, and the next cluster is taken again."""
    estimator, update, calls = smoother(state_interval=interval), LagWindow.solve, []

    def failing(window: LagWindow, added: GraphUpdate) -> States:
        calls.append(1)
        if len(calls) <= fails:
            raise RuntimeError("GTSAM's own words")
        return update(window, added)

    for number, (stop, part) in enumerate(regular(tracklets(clusters=9))):
        if number == 6:
            monkeypatch.setattr(LagWindow, "solve", failing)
        estimator.update(stop, part)
    trajectory = estimator.trajectory()
    assert trajectory is not None
    assert trajectory.stop == pytest.approx(9 * PERIOD)
    assert (np.diff(trajectory.t) > 0).all()
    assert np.abs(errors(trajectory)).max() < 0.02
    assert "GTSAM's own words" in estimator.diagnostics[0].reason
    assert all(found.key.startswith("x") for found in estimator.diagnostics)
    assert len(estimator.diagnostics) == (2 if fails == 3 else 1)


@pytest.mark.parametrize("interval", INTERVALS)
def test_landmarks_that_stay_are_honest_for_ever(interval: float) -> None:
    """Exact measurements leave the truth, and no covariance is less than a wide window's."""
    parts = seen_forever(24)
    trajectory = estimate(parts, POINTS, window=4, state_interval=interval)
    assert np.abs(errors(trajectory, 0.3 * TWIST)).max() < 1e-3
    assert np.abs(trajectory.twist - 0.3 * TWIST).max() < 1e-2
    whole = estimate(parts, POINTS, window=100, state_interval=interval)
    t = np.linspace(0.1, trajectory.stop, 40)
    ours, theirs = (np.diagonal(x.covariance(t), 0, 1, 2) for x in (trajectory, whole))
    assert (ours > 0.99 * theirs).all()


@pytest.mark.parametrize("drift", [0.0, 0.25, 4.0])
def test_tracks_that_drift_on_their_landmarks_are_less_certain(drift: float) -> None:
    """The more they drift, the less a landmark's older measurements count; it is monotonous."""
    parts, stop = seen_forever(16), 16 * PERIOD
    less, more = (
        estimate(parts, NoiseConfig(track_drift=x), window=4).covariance(stop)
        for x in (drift, drift + 0.5)
    )
    ratio = np.diag(more)[:6] / np.diag(less)[:6]
    assert (ratio > 1 if drift < 1 else ratio > 0.999).all()
    assert np.linalg.eigvalsh(more - less).min() > -1e-9


def test_disparities_drift_by_a_share() -> None:
    """The more they do, the less certain is the way ahead."""
    parts, stop = seen_forever(16), 16 * PERIOD
    variances = []
    for share in (0.0, 0.2, 1.0, 5.0):
        noise = NoiseConfig(track_drift=1.0, disparity_drift=share)
        covariance = estimate(parts, noise, window=4).covariance(stop)
        variances.append(np.trace(covariance[3:6, 3:6]))
    assert (np.diff(variances) > 0).all()


@pytest.mark.parametrize("interval", INTERVALS)
def test_measurements_that_come_late_count_the_same(interval: float) -> None:
    """While the states that they lie between are in the window."""
    parts = tracklets(clusters=8, noise=0.3)
    late = [*parts[:3], parts[3][::2], Measurements.concatenate([parts[3][1::2], parts[4]])]
    settings = {"state_interval": interval, "window": 20}
    in_time = fed(smoother(**settings), regular(parts))
    delayed = fed(smoother(**settings), regular([*late, *parts[5:]]))
    assert np.array_equal(in_time.t, delayed.t)
    assert deviation(delayed, in_time).max() < 0.05


@pytest.mark.parametrize("interval", INTERVALS)
def test_measurements_that_come_late_to_the_first_state_that_stays_count(interval: float) -> None:
    """They are in the window as long as its states are."""
    parts = tracklets(clusters=9, noise=0.01)
    late = [*parts[:3], parts[3][::2], parts[4], parts[5]]
    late[5] = Measurements.concatenate([parts[3][1::2], parts[5]])
    settings = {"state_interval": interval, "window": 3}
    delayed = fed(estimator := smoother(**settings), regular([*late, *parts[6:]]))
    in_time = fed(smoother(**settings), regular(parts))
    assert not estimator.diagnostics
    assert deviation(delayed, in_time, 7 * PERIOD).max() < 0.02


@pytest.mark.parametrize("cluster", [0, 5])
def test_measurements_before_the_window_are_listed(cluster: int) -> None:
    """With their landmark, time and values, also of states that leave; all else is as without."""
    parts = tracklets(clusters=10, noise=0.3)
    late = parts[cluster][:5]
    settings = {"window": 3}
    clusters = regular([*parts[:8], Measurements.concatenate([late, parts[8]]), parts[9]])
    delayed = fed(estimator := smoother(**settings), clusters)
    plain = fed(smoother(**settings), regular(parts))
    assert [(d.key, d.t) for d in estimator.diagnostics] == [
        (f"l{landmark}", t) for landmark, t in zip(late.landmark, late.t, strict=True)
    ]
    assert all("before the window" in found.reason for found in estimator.diagnostics)
    assert [d.measurement for d in estimator.diagnostics] == list(map(tuple, late.stereo.tolist()))
    assert np.array_equal(delayed.T_world_cam, plain.T_world_cam)


@pytest.mark.parametrize("interval", INTERVALS)
def test_a_cluster_in_two_parts_of_which_one_has_no_length_is_the_whole(interval: float) -> None:
    """In the window; a state's last estimate may be that before the second part."""
    clusters = regular(tracklets(clusters=9, noise=0.1))
    parts = [(stop, part[n::2]) for stop, part in clusters[1:] for n in range(2)]
    settings = {"state_interval": interval, "lag": 3 * PERIOD}
    whole = fed(smoother(**settings), clusters)
    halves = fed(smoother(**settings), [clusters[0], *parts])
    assert np.isin(whole.t[whole.t > whole.stop - 2 * PERIOD], halves.t).all()
    assert deviation(halves, whole, whole.stop - 2 * PERIOD).max() < 0.05


@pytest.mark.parametrize(
    "settings",
    [
        {"settling": 0.1},
        {"settling": 0.0, "state_interval": 0.1},
        {"settling": 0.1, "loss": "cauchy"},
    ],
)
def test_final_states_stay_and_the_same_input_gives_the_same_bits(
    settings: dict[str, object],
) -> None:
    estimator, clusters = smoother(**settings), irregular()
    final = States()
    for stop, part in clusters:
        estimator.update(stop, part)
        before, final = final, estimator.final_states()
        for column in ("t", "T_world_cam", "twist"):
            kept = getattr(final, column)[: len(before)]
            assert np.array_equal(kept, getattr(before, column))
        if len(final):
            assert final.t[-1] < estimator.states.t[0]
            assert np.array_equal(estimator.final_states(final.t[0]).t, final.t[1:])
    first, again = estimator.trajectory(), fed(smoother(**settings), clusters)
    assert first is not None and len(final) >= 10
    for column in ("t", "T_world_cam", "twist", "knots", "knot_covariance"):
        assert np.array_equal(getattr(first, column), getattr(again, column))


@pytest.mark.parametrize("interval", INTERVALS)
def test_asking_for_the_trajectory_changes_nothing(interval: float) -> None:
    asked, plain = smoother(state_interval=interval), smoother(state_interval=interval)
    for stop, part in irregular():
        asked.update(stop, part)
        asked.trajectory()
        assert len(asked.states) >= len(asked.window)
        plain.update(stop, part)
    ours, theirs = asked.trajectory(), plain.trajectory()
    assert ours is not None and theirs is not None
    assert np.array_equal(ours.T_world_cam, theirs.T_world_cam)
    assert np.array_equal(ours.knot_covariance, theirs.knot_covariance)


@pytest.mark.parametrize("interval", INTERVALS)
def test_pose_and_velocity_are_continuous_at_every_state(interval: float) -> None:
    """Where states are at least a microsecond apart, so that both sides are in one interval."""
    trajectory = fed(smoother(state_interval=interval), irregular())
    apart = np.minimum(np.diff(trajectory.t)[:-1], np.diff(trajectory.t)[1:]) > 1e-6
    t = trajectory.t[1:-1][apart]
    for h in (1e-6, 1e-9):
        before, after = t - h, t + h
        step = se3_log(se3_inverse(trajectory.pose(before)) @ trajectory.pose(after))
        # Between states microseconds apart the second derivative is what rounding errors make it.
        assert np.abs(step - 2 * h * trajectory.velocity(before)).max() < h**2 * 1e4 + 1e-13
        change = trajectory.velocity(after) - trajectory.velocity(before)
        assert np.abs(change).max() < 1e4 * h


ENDS, BETWEEN = np.array([0.15, 0.3, 0.35]), np.array([0.17, 0.225, 0.31, 0.375])


@pytest.mark.parametrize("interval", INTERVALS)
def test_covariances_are_honest_at_the_clusters_ends_and_between(interval: float) -> None:
    """Mean NEES over simulated runs; the benchmark does it with a hundred."""
    runs, values = 14, []
    config = EstimatorConfig(window=4, state_interval=interval)
    for seed in range(runs):
        rng, simulation = np.random.default_rng(seed), TrackletSimulation(POINTS, 6)
        motion = simulation.motion(0.4, rng)
        estimator = FixedLagSmoother(simulation.camera, POINTS, config)
        trajectory = fed(estimator, list(simulation.clusters(motion, rng)))
        values.append(nees(trajectory, motion, np.concatenate([ENDS, BETWEEN])))
    low, high = mean_nees_interval(runs, 0.995)
    mean = np.mean(values, axis=0)
    assert ((mean > low) & (mean < high)).all(), mean
