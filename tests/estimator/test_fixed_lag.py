"""GTSAM's fixed-lag smoother: every measurement told once, at key times as at unique ones."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gpvo.estimator.structureless_landmarks import GOLDEN
from gtsam.symbol_shorthand import V, X
from synthetic import CAMERA, TWIST, constant_velocity, tracklets
from test_estimators import NOTHING, PERIOD

from factors import StructurelessStereoFactor
from factors.lie import se3_inverse, se3_log
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator import FixedLagSmoother
from gpvo.estimator.batch_graph import Window
from gpvo.estimator.graph_builder import FactorMaker
from gpvo.estimator.graph_update import Increment
from gpvo.evaluation.metrics.nees import mean_nees_interval, nees
from gpvo.simulation.tracklets import TrackletSimulation
from gpvo.tracking import Measurements, seen_twice
from gpvo.trajectory import States, Trajectory

Cluster = tuple[float, Measurements]
NOISE = NoiseConfig()


def smoother(**settings: object) -> FixedLagSmoother:
    """Of landmarks eliminated at key times, if the settings do not tell otherwise."""
    config = EstimatorConfig.model_validate({"state_interval": 0.1, "window": 4} | settings)
    return FixedLagSmoother(CAMERA, NOISE, config)


def regular(parts: list[Measurements]) -> list[Cluster]:
    return [((frame + 1) * PERIOD, part) for frame, part in enumerate(parts)]


def fed(estimator: FixedLagSmoother, clusters: list[Cluster]) -> Trajectory:
    for frame, (stop, part) in enumerate(clusters):
        estimator.update(frame, stop, part, None)
    trajectory = estimator.trajectory(0)
    assert trajectory is not None
    return trajectory


def turns(part: Measurements, window: int) -> np.ndarray:
    """(N,) windows of the landmarks that measurements fall into, each landmark's at its turn."""
    phase = GOLDEN * (1 + part.landmark) % 1
    return np.floor(part.frame / window + phase).astype(np.int64)


def split_at_turns(parts: list[Measurements], window: int) -> list[Measurements]:
    """The same, of another landmark in every window, as if they had been found anew."""
    return [replace(p, landmark=1000 * p.landmark + turns(p, window)) for p in parts]


def within_turns(parts: list[Measurements], window: int) -> list[Measurements]:
    """Without the landmarks that are measured in more than one of their windows."""
    together = Measurements.concatenate(parts)
    seen = np.unique(np.column_stack([together.landmark, turns(together, window)]), axis=0)
    landmark, count = np.unique(seen[:, 0], return_counts=True)
    return [part[~np.isin(part.landmark, landmark[count > 1])] for part in parts]


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


def deviation(
    trajectory: Trajectory, reference: Trajectory, start: float | None = None
) -> np.ndarray:
    """(N, 12) difference of pose and velocity in the reference's standard deviations."""
    t = np.linspace(start or reference.start, reference.stop, 100)[1:]
    difference = se3_log(se3_inverse(reference.pose(t)) @ trajectory.pose(t))
    difference = np.hstack([difference, trajectory.velocity(t) - reference.velocity(t)])
    return np.abs(difference) / np.sqrt(np.diagonal(reference.covariance(t), 0, 1, 2))


def factors_in(estimator: FixedLagSmoother) -> list[gtsam.NonlinearFactor]:
    graph = estimator._smoother.getFactors()
    return [graph.at(i) for i in range(graph.size()) if graph.at(i) is not None]


def told_rows(measurements: Measurements) -> set[tuple[float, ...]]:
    return {(t, *stereo) for t, stereo in zip(measurements.t, measurements.stereo, strict=True)}


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


def test_eliminated_landmarks_tell_what_those_in_the_graph_tell() -> None:
    """While each is measured in one of its windows only, also after it has left."""
    clusters = regular(within_turns(tracklets(clusters=10, per_cluster=14, noise=0.1), 4))
    variables = fed(smoother(landmarks="variables"), clusters)
    eliminated = fed(smoother(), clusters)
    assert np.array_equal(eliminated.t, variables.t)
    # Each makes one step of Gauss-Newton a cluster, in other coordinates of the landmarks.
    assert deviation(eliminated, variables).max() < 0.05
    ours, theirs = (np.diagonal(x.knot_covariance, 0, 1, 2) for x in (eliminated, variables))
    assert np.allclose(ours, theirs, rtol=0.02)


@pytest.mark.parametrize("interval", [0.025, 0.1])
def test_information_is_that_of_a_batch_over_the_same_landmarks(interval: float) -> None:
    """However often the factor was replaced: nothing is counted twice, and nothing is lost.

    With little noise, so that both linearize at the same motion.
    """
    parts = tracklets(clusters=10, noise=0.01)
    trajectory = fed(smoother(state_interval=interval), regular(parts))
    told = seen_twice(Measurements.concatenate(split_at_turns(parts, 4)))
    states = States(trajectory.t, trajectory.T_world_cam, trajectory.twist)
    anchor = np.diag(np.repeat([1e-6, NOISE.initial_velocity], 6) ** 2)
    window, make = Window(states, told, anchor), FactorMaker(CAMERA, NOISE)
    expected = window.joint_covariances(make, len(states) - 1)[-1, 12:, 12:]
    scale = np.sqrt(np.diag(expected))
    difference = (trajectory.covariance(trajectory.stop) - expected) / np.outer(scale, scale)
    assert np.abs(difference).max() < 2e-3
    best = window.optimize(make, EstimatorConfig(relative_decrease=1e-9))
    moved = se3_log(se3_inverse(best.T_world_cam[-1]) @ trajectory.T_world_cam[-1])
    moved = np.concatenate([moved, best.twist[-1] - trajectory.twist[-1]])
    assert (np.abs(moved) / scale).max() < 0.05


def test_no_measurement_is_in_two_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither in those that were marginalized nor in the one that follows."""
    calls: list[Measurements] = []
    make = FactorMaker.structureless

    def spied(
        maker: FactorMaker, numbers: range, t: np.ndarray, measurements: Measurements
    ) -> gtsam.NonlinearFactor:
        calls.append(measurements)
        return make(maker, numbers, t, measurements)

    monkeypatch.setattr(FactorMaker, "structureless", spied)
    estimator, final = smoother(), Counter[tuple[float, ...]]()
    for frame, (stop, part) in enumerate(irregular()):
        calls.clear()
        estimator.update(frame, stop, part, None)
        follows = any(isinstance(f, StructurelessStereoFactor) for f in factors_in(estimator))
        followed = told_rows(calls.pop()) if follows else set[tuple[float, ...]]()
        for leaving in calls:
            final.update(told_rows(leaving))
        assert max(final.values(), default=0) <= 1
        assert followed.isdisjoint(final)
    assert len(final) > 100
    assert not estimator.repairs


def check_graph(estimator: FixedLagSmoother, anchored: int) -> tuple[list[int], list[int]]:
    """Each structureless factor's count of states, and each GPS factor's state; others are checked.

    There are priors on the state `anchored`, or a linear factor of what was marginalized, and one
    WNOA prior between two states each.
    """
    window, factors = estimator.window, factors_in(estimator)
    inside = {key(k) for k in window for key in (X, V)}
    assert all(inside.issuperset(factor.keys()) for factor in factors)
    kinds = Counter(type(factor).__name__ for factor in factors)
    at_start = kinds["PriorFactorPose3"], kinds["PriorFactorVector"], kinds["LinearContainerFactor"]
    assert at_start == ((1, 1, 0) if window[0] == anchored else (0, 0, 1))
    pairs = [frozenset([X(k), V(k), X(k + 1), V(k + 1)]) for k in window[:-1]]
    motion = [frozenset(f.keys()) for f in factors if type(f) is gtsam.CustomFactor]
    assert Counter(motion) == Counter(pairs)
    told = [f.size() // 2 for f in factors if isinstance(f, StructurelessStereoFactor)]
    gps = [gtsam.symbolIndex(f.keys()[0]) for f in factors if isinstance(f, gtsam.GPSFactor)]
    assert len(factors) == sum(at_start) + len(motion) + len(told) + len(gps)
    return told, sorted(gps)


@pytest.mark.parametrize("fails_at", [None, 7])
def test_a_factor_that_is_replaced_takes_no_other_one_with_it(
    monkeypatch: pytest.MonkeyPatch, fails_at: int | None
) -> None:
    """After every update, also when the window was solved anew because one failed."""
    update, failed = FixedLagSmoother._update, list[int]()

    def failing(smoother: FixedLagSmoother, increment: Increment) -> None:
        if frame == fails_at and not failed:
            failed.append(frame)
            raise RuntimeError("indeterminate")
        update(smoother, increment)

    monkeypatch.setattr(FixedLagSmoother, "_update", failing)
    estimator, model = smoother(), gtsam.noiseModel.Isotropic.Sigma(3, 1.0)
    added: list[int] = []
    replaced = anchored = 0
    for frame, (stop, part) in enumerate(irregular()):
        repairs = len(estimator.repairs)
        estimator.update(frame, stop, part, None)
        if len(estimator.repairs) > repairs:
            anchored = estimator.window[0]
        told, gps = check_graph(estimator, anchored)
        assert len(told) <= 1
        replaced += len(told)
        assert gps == [state for state in added if state >= estimator.window[0]]
        added.append(estimator.window[-1])
        estimator.add(gtsam.GPSFactor(X(added[-1]), np.zeros(3), model))
    assert replaced > 8
    assert bool(estimator.repairs) == (fails_at is not None)


def test_landmarks_that_stay_are_told_honestly_for_ever() -> None:
    """Exact measurements leave the truth, and parts of a landmark tell no more than the whole."""
    clusters = regular(seen_forever(24))
    eliminated = fed(smoother(), clusters)
    truth = constant_velocity(eliminated.t, 0.3 * TWIST)
    error = se3_log(se3_inverse(se3_inverse(truth[0]) @ truth) @ eliminated.T_world_cam)
    assert np.abs(error).max() < 1e-3
    assert np.abs(eliminated.twist - 0.3 * TWIST).max() < 1e-2
    whole = fed(smoother(landmarks="variables"), clusters)
    ours, theirs = (np.diagonal(x.knot_covariance, 0, 1, 2)[:, 12:] for x in (eliminated, whole))
    assert (ours > 0.99 * theirs).all()
    assert (ours[-1, :6] > 1.2 * theirs[-1, :6]).all()


@pytest.mark.parametrize("landmarks", ["eliminated", "variables"])
def test_measurements_that_come_late_tell_the_same(landmarks: str) -> None:
    """While the states that they lie between are in the window."""
    parts = tracklets(clusters=8, noise=0.3)
    late = [*parts[:3], parts[3][::2], Measurements.concatenate([parts[3][1::2], parts[4]])]
    estimators = [smoother(landmarks=landmarks, window=20) for _ in range(2)]
    in_time = fed(estimators[0], regular(parts))
    delayed = fed(estimators[1], regular([*late, *parts[5:]]))
    assert np.array_equal(in_time.t, delayed.t)
    assert deviation(delayed, in_time).max() < 0.05


@pytest.mark.parametrize("landmarks", ["eliminated", "variables"])
def test_a_cluster_in_two_parts_of_which_one_has_no_length_is_the_whole(landmarks: str) -> None:
    """In the window; a state's last estimate may be that before the second part."""
    clusters = regular(tracklets(clusters=9, noise=0.1))
    parts = [(stop, part[n::2]) for stop, part in clusters[1:] for n in range(2)]
    settings = {"landmarks": landmarks, "lag": 3 * PERIOD}
    whole = fed(smoother(**settings), clusters)
    halves = fed(smoother(**settings), [clusters[0], *parts])
    assert np.array_equal(whole.t, halves.t)
    assert deviation(halves, whole, whole.stop - 2 * PERIOD).max() < 0.05


@pytest.mark.parametrize("settings", [{}, {"landmarks": "variables"}, {"state_interval": 0.0}])
def test_final_states_stay_and_the_same_input_gives_the_same_bits(
    settings: dict[str, object],
) -> None:
    estimator, clusters = smoother(**settings), irregular()
    settled = States()
    for frame, (stop, part) in enumerate(clusters):
        estimator.update(frame, stop, part, None)
        before, settled = settled, estimator.settled(-1.0)
        for column in ("t", "T_world_cam", "twist"):
            kept = getattr(settled, column)[: len(before)]
            assert np.array_equal(kept, getattr(before, column))
    first, again = estimator.trajectory(0), fed(smoother(**settings), clusters)
    assert first is not None and len(settled) >= 10
    for column in ("t", "T_world_cam", "twist", "knots", "knot_covariance"):
        assert np.array_equal(getattr(first, column), getattr(again, column))


@pytest.mark.parametrize("landmarks", ["eliminated", "variables"])
def test_pose_and_velocity_are_continuous_at_every_state(landmarks: str) -> None:
    trajectory = fed(smoother(landmarks=landmarks), irregular())
    for h in (1e-6, 1e-9):
        before, after = trajectory.t[1:-1] - h, trajectory.t[1:-1] + h
        step = se3_log(se3_inverse(trajectory.pose(before)) @ trajectory.pose(after))
        assert np.abs(step - 2 * h * trajectory.velocity(before)).max() < h**2 * 1e3 + 1e-14
        change = trajectory.velocity(after) - trajectory.velocity(before)
        assert np.abs(change).max() < 1e3 * h


@pytest.mark.parametrize(
    "runs, per_cluster, settings",
    [(24, 6, {"state_interval": 0.1}), (12, 4, {"state_interval": 0.0})],
)
def test_covariances_are_honest(runs: int, per_cluster: int, settings: dict[str, object]) -> None:
    """Mean NEES over simulated runs; the benchmark does it with a hundred."""
    config = EstimatorConfig.model_validate({"method": "fixed_lag", "window": 4} | settings)
    values = []
    for seed in range(runs):
        rng, simulation = np.random.default_rng(seed), TrackletSimulation(NOISE, per_cluster)
        motion = simulation.motion(0.4, rng)
        estimator = FixedLagSmoother(simulation.camera, NOISE, config)
        trajectory = fed(estimator, list(simulation.clusters(motion, rng)))
        values.append(nees(trajectory, motion, np.array([0.15, 0.35])))
    low, high = mean_nees_interval(runs, 0.99)
    mean = np.mean(values, axis=0)
    assert ((mean > low) & (mean < high)).all(), mean
