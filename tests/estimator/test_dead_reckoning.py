"""Where nothing measures the motion: it does not go on for ever, and it begins anew afterwards."""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate
from typing import Any

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X

from benchmarks.simulated_tracklets import TrackletSimulation
from factors.lie import se3_exp, se3_inverse, se3_log
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator import FixedLagSmoother, InitialState, make_estimator
from gpvo.estimator.dead_reckoning import (
    ENOUGH,
    LEAST_SPEED,
    LIVELY,
    LOOSE,
    MEMORY,
    MOST_STEPS,
    DeadReckoning,
)
from gpvo.evaluation.metrics.nees import nees
from gpvo.mc_ransac import VelocityFit
from gpvo.tracking import Measurements
from gpvo.trajectory import States, Trajectory

BRIDGE, PERIOD = 0.3, 0.05
NOTHING = Measurements.concatenate([])
NOISE = NoiseConfig(track_drift=0.0, initial_velocity=0.3)


def run(
    seed: int,
    gap: tuple[float, float],
    duration: float,
    bridge: float = BRIDGE,
    method: str = "fixed_lag",
) -> tuple[Trajectory, States, Any]:
    """Estimate tracklets of which those in a gap are missing; return the true motion too.

    Batch has fewer landmarks, and states at key times: it takes seconds then instead of minutes.
    """
    simulation = TrackletSimulation(NOISE, per_cluster=12 if method == "fixed_lag" else 8)
    rng = np.random.default_rng(seed)
    motion = simulation.motion(duration, rng)
    keys = {"state_interval": 0.05} if method == "batch" else {}
    config = EstimatorConfig.model_validate({"bridge": bridge, "method": method, **keys})
    smoother = make_estimator(simulation.camera, NOISE, config)
    for end_time, measurements in simulation.clusters(motion, rng):
        if gap[0] < end_time <= gap[1] + 1e-9:
            measurements = NOTHING
        smoother.update(end_time, measurements)
    trajectory = smoother.trajectory()
    assert trajectory is not None
    return trajectory, motion, smoother


@pytest.mark.parametrize("method", ["fixed_lag", "batch"])
def test_a_velocity_that_is_not_measured_is_forgotten(method: str) -> None:
    start, stop = 0.4, 3.4
    trajectory, _, _ = run(1, (start, stop), stop, method=method)
    speed = np.linalg.norm(trajectory.velocity([start, stop - 1e-6]), axis=1)
    way = np.linalg.norm(trajectory.pose([start, stop - 1e-6])[:, :3, 3], axis=1)
    assert speed[1] < 1e-3 * speed[0]
    assert way[1] - way[0] < (BRIDGE + 0.3) * speed[0]
    times = [start, start + 1.0, start + 2.0, stop - 1e-6]
    deviation = np.sqrt(trajectory.covariance(times)[:, 3, 3])
    assert (np.diff(deviation) > 0.05).all()


def test_the_prior_alone_keeps_the_velocity() -> None:
    trajectory, _, _ = run(1, (0.4, 3.4), 3.4, bridge=0.0)
    v = trajectory.velocity([0.4, 3.4 - 1e-6])
    np.testing.assert_allclose(v[1], v[0], atol=1e-6)


def test_a_short_gap_is_bridged_as_the_prior_does() -> None:
    short, kept = (run(2, (0.5, 0.65), 1.0, bridge)[0] for bridge in (BRIDGE, 0.0))
    np.testing.assert_array_equal(short.T_world_cam, kept.T_world_cam)
    np.testing.assert_array_equal(short.knot_covariance, kept.knot_covariance)


def test_after_a_break_the_error_is_what_the_covariance_says() -> None:
    """Mean NEES of 5 runs; that of the motion since the break as good as without one."""
    t = np.array([1.8, 2.1])
    found = np.array([nees(*run(seed, (0.5, 1.4), 2.15)[:2], t) for seed in range(5)])
    pose, velocity = found.mean(axis=0)
    assert (pose < 9).all() and (velocity > 3).all() and (velocity < 9).all()


@pytest.mark.parametrize("seed", [0, 1])  # in which the camera still sees them
def test_after_a_break_known_landmarks_tell_where_the_camera_is(seed: int) -> None:
    """The same landmarks are measured again; under other numbers they are not known."""
    simulation = TrackletSimulation(NOISE, per_cluster=6, length=100)
    motion = simulation.motion(1.8, np.random.default_rng(seed))
    errors, deviations = {}, {}
    for renamed in (0, 10_000):
        rng, config = np.random.default_rng(seed), EstimatorConfig(bridge=BRIDGE)
        smoother = FixedLagSmoother(simulation.camera, NOISE, config)
        for end_time, measurements in simulation.clusters(motion, rng):
            if 0.8 < end_time <= 1.4 + 1e-9:
                measurements = NOTHING
            elif end_time > 1.4:
                measurements = replace(measurements, landmark=measurements.landmark + renamed)
            smoother.update(end_time, measurements, velocity_at(motion, end_time))
        trajectory = smoother.trajectory()
        assert trajectory is not None
        t, start = np.array([1.5, 1.75]), motion.query(np.array([trajectory.start]))[0]
        true = se3_inverse(start) @ motion.query(t)[0]
        error = se3_log(se3_inverse(trajectory.pose(t)) @ true)
        covariance = trajectory.covariance(t)[:, :6, :6]
        errors[renamed] = np.linalg.norm(error[:, 3:], axis=1)
        deviations[renamed] = np.sqrt(np.trace(covariance[:, 3:, 3:], axis1=1, axis2=2))
        assert (np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error) < 22.5).all()
    assert (errors[0] < 0.01).all()
    assert (deviations[10_000] > 20 * deviations[0]).all()


@pytest.mark.parametrize("seed", [0, 1])
def test_the_path_leads_to_where_known_landmarks_tell_that_the_camera_is(seed: int) -> None:
    """The guess is off by a decimetre, which was one step of the path."""
    simulation = TrackletSimulation(NOISE, per_cluster=6, length=100)
    rng, motion = np.random.default_rng(seed), simulation.motion(1.8, np.random.default_rng(seed))
    smoother = FixedLagSmoother(simulation.camera, NOISE, EstimatorConfig(bridge=BRIDGE))
    for end_time, measurements in simulation.clusters(motion, rng):
        measured = measurements if not 0.8 < end_time <= 1.4 + 1e-9 else NOTHING
        smoother.update(end_time, measured, velocity_at(motion, end_time))
    trajectory = smoother.trajectory()
    assert trajectory is not None
    path = trajectory.pose(np.arange(0.7, 1.7, 0.01))[:, :3, 3]
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert steps.max() < 2 * np.median(steps)


def velocity_at(motion: States, t: float) -> VelocityFit:
    """Return the true velocity at a time as MC-RANSAC would."""
    twist = motion.query(np.array([t]))[1][0]
    return VelocityFit(twist, 1e-4 * np.eye(6), np.ones(0, bool))


def test_after_a_break_batch_is_as_certain_as_it_may_be() -> None:
    """Mean NEES of 3 runs; 0.3 if it goes on at a velocity that may be any."""
    t = np.array([1.35, 1.45])
    every = (run(seed, (0.2, 1.1), 1.5, method="batch")[:2] for seed in range(3))
    pose, _ = np.array([nees(*one, t) for one in every]).mean(axis=0)
    assert (pose > 1).all() and (pose < 9).all()


def test_after_a_break_the_motion_is_as_certain_as_before() -> None:
    trajectory, _, smoother = run(3, (0.6, 1.5), 2.2)
    deviations = np.sqrt(np.diagonal(trajectory.covariance([0.5, 2.1]), 0, 1, 2))
    pose, velocity = deviations[:, :6], deviations[:, 6:]
    np.testing.assert_allclose(velocity[1], velocity[0], rtol=0.5)
    assert (pose[1] > 10 * pose[0]).all()
    newest = smoother.window[-1]
    np.testing.assert_allclose(
        smoother.marginalCovariance(X(newest)),
        trajectory.covariance(smoother.window_times[-1])[:6, :6],
        rtol=1e-6,
        atol=1e-12,
    )
    assert (np.diff(trajectory.t) > 0).all()


@pytest.mark.parametrize("lag", [None, 10.0])
def test_measurements_that_come_late_after_a_break_do_no_harm(lag: float | None) -> None:
    """They are of the window's first interval, so that the new segment begins where it did."""
    simulation, rng = TrackletSimulation(NOISE, per_cluster=20), np.random.default_rng(5)
    motion = simulation.motion(0.7, rng)
    config = EstimatorConfig(bridge=BRIDGE, lag=lag)
    smoother = FixedLagSmoother(simulation.camera, NOISE, config)
    clusters = list(simulation.clusters(motion, rng))
    smoother.update(*clusters[0])
    for end_time, _ in clusters[1:10]:
        smoother.update(end_time, NOTHING)
    end_time, late = clusters[10]
    first = smoother.window_times[0]
    late = replace(late, t=np.linspace(first + 1e-3, first + 2e-3, len(late)))
    smoother.update(end_time, late)
    for end_time, measurements in clusters[11:]:
        smoother.update(end_time, measurements)
    trajectory = smoother.trajectory()
    assert trajectory is not None and (np.diff(trajectory.t) > 0).all()
    assert np.isfinite(trajectory.covariance([0.1, 0.5, 0.65])).all()


def test_with_factors_of_your_own_the_graph_stays_one() -> None:
    """A GPS-like factor after the break must be able to correct the pose."""
    simulation, rng = TrackletSimulation(NOISE, per_cluster=12), np.random.default_rng(4)
    motion = simulation.motion(1.9, rng)
    smoother = FixedLagSmoother(simulation.camera, NOISE, EstimatorConfig(bridge=BRIDGE))
    exact = gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)
    for end_time, measurements in simulation.clusters(motion, rng):
        inside = 0.6 < end_time <= 1.4 + 1e-9
        smoother.update(end_time, NOTHING if inside else measurements)
        if abs(end_time - 0.5) < 1e-9 or end_time > 1.6:
            k = smoother.window[-1]
            pose = gtsam.Pose3(motion.query(np.array([end_time]))[0][0])
            smoother.add(gtsam.PriorFactorPose3(X(k), pose, exact))
    trajectory = smoother.trajectory()
    assert trajectory is not None
    true = motion.query(np.array([1.8]))[0][0]
    np.testing.assert_allclose(trajectory.pose(1.8)[:3, 3], true[:3, 3], atol=0.01)


@pytest.mark.parametrize("dt", [0.02, 0.05, 0.1])
def test_the_guessed_velocity_settles_at_the_speed_seen_last(dt: float) -> None:
    """Of the Riccati equation of prior and measurement, the solution is the speed's square."""
    reckoning = DeadReckoning(BRIDGE)
    reckoning.measured(0.0, np.array([0.9, 0, 0, 0, 0.8, 0.0]), 100)
    reckoning.extend(BRIDGE, BRIDGE + dt)
    t = np.array([BRIDGE, BRIDGE + dt])
    qc = reckoning.densities(t, np.zeros(6))[0]
    (factor,) = reckoning.at_rest(range(2), t)
    assert isinstance(factor, gtsam.PriorFactorVector)
    R = np.array(factor.noiseModel().sigmas()) ** 2
    assert (LEAST_SPEED < [0.9, 0.8]).all()
    predicted = (LIVELY * np.repeat([0.9, 0.8], 3)) ** 2
    # before the measurement the variance is s^2 / (1 - K), after it s^2
    ahead = predicted + qc * dt
    np.testing.assert_allclose(ahead * R / (ahead + R), predicted, rtol=1e-6)


@pytest.mark.parametrize("deviation", [0.01, 0.05])
def test_learned_noise_does_not_depend_on_what_is_known_of_the_first_pose(
    deviation: float,
) -> None:
    """What all poses have in common is no error of the motion between them."""
    noise = NoiseConfig(track_drift=0.0, motion_memory=1.0)
    simulation, rng = TrackletSimulation(noise, per_cluster=30), np.random.default_rng(5)
    motion = simulation.motion(0.5, rng)
    learned = []
    for pose in (1e-6, deviation):
        covariance = np.diag(np.repeat([pose, 1.0], 6) ** 2)
        initial = InitialState(np.eye(4), np.zeros(6), covariance)
        smoother = FixedLagSmoother(simulation.camera, noise, initial=initial)
        for end_time, measurements in simulation.clusters(motion, np.random.default_rng(6)):
            smoother.update(end_time, measurements)
        learned.append(smoother.noise.acceleration_psd)
    np.testing.assert_allclose(learned[1], learned[0], rtol=0.02)


def test_a_turn_in_a_gap_is_found_at_once_by_landmarks_of_before() -> None:
    """One Gauss-Newton step from the guess, which is 20 degrees off, leaves 29 mm."""
    simulation, rng = (
        TrackletSimulation(NOISE, per_cluster=40, length=100),
        np.random.default_rng(1),
    )
    dt, turn = 0.005, np.array([0.26, 0.70, 0.44, 0.0, 0.0, 0.0])
    t = dt * np.arange(201)
    twist = [0, 0, 0, 0.2, 0, 0] + turn * ((t >= 0.4) & (t < 0.8))[:, None]
    T = list(accumulate(se3_exp(dt * twist), np.matmul, initial=np.eye(4)))[: len(t)]
    smoother = FixedLagSmoother(simulation.camera, NOISE, EstimatorConfig(bridge=0.75))
    for end_time, measurements in simulation.clusters(States(t, np.array(T), twist), rng):
        known = measurements[measurements.landmark < 80]
        gap = 0.4 < end_time <= 0.8 + 1e-9
        smoother.update(end_time, NOTHING if gap else known)
        if end_time > 0.8 + 1e-9:
            break
    latest = smoother.latest()
    assert latest is not None
    error = se3_log(se3_inverse(T[170]) @ latest.T_world_cam)
    assert np.linalg.norm(error[3:]) < 0.01 and np.linalg.norm(error[:3]) < 0.01


@pytest.mark.parametrize("last", [1.0, 1.05])
def test_a_break_has_states_where_the_motion_is_guessed_otherwise(last: float) -> None:
    """Beyond the bridge they are near enough for its memory, in breaks of any length few."""
    reckoning = DeadReckoning(BRIDGE)
    reckoning.measured(1.0, np.zeros(6), ENOUGH)
    assert len(reckoning.steps(last, last + BRIDGE)) == 0
    steps = reckoning.steps(last, 3.0)
    assert steps[0] == pytest.approx(1.0 + LOOSE) and steps[1] == pytest.approx(1.0 + BRIDGE)
    assert steps[-1] == 3.0 and (np.diff(steps) <= MEMORY / 2 + 1e-9).all()
    assert len(reckoning.steps(last, 1000.0)) == MOST_STEPS + 2
    assert len(DeadReckoning(0.0).steps(last, 1000.0)) == 0


@pytest.mark.parametrize("bridge", [1e-9, 0.01, LOOSE / 2])
def test_states_of_a_break_are_within_it_however_short_the_bridge(bridge: float) -> None:
    reckoning = DeadReckoning(bridge)
    reckoning.measured(1.0, np.zeros(6), ENOUGH)
    steps = reckoning.steps(1.0, 1.15)
    assert len(steps) > 0 and steps[-1] == 1.15
    assert (np.diff(steps) >= 0).all() and steps[0] > 1.0


@pytest.mark.parametrize("seed", [2, 3])
def test_a_break_without_clusters_is_as_one_with_clusters_that_show_nothing(seed: int) -> None:
    """Events that are missing, and those of a covered lens: the same is known of the motion."""
    gap = 0.5, 2.0
    with_clusters, motion, _ = run(seed, gap, 2.5)
    simulation = TrackletSimulation(NOISE, per_cluster=12)
    rng = np.random.default_rng(seed)
    motion, config = simulation.motion(2.5, rng), EstimatorConfig(bridge=BRIDGE)
    smoother = FixedLagSmoother(simulation.camera, NOISE, config)
    for end_time, measurements in simulation.clusters(motion, rng):
        if not gap[0] < end_time <= gap[1] + 1e-9:
            smoother.update(end_time, measurements)
    without = smoother.trajectory()
    assert without is not None
    after, t = np.array([2.2, 2.45]), np.array([0.7, 1.0, 1.6])
    np.testing.assert_allclose(without.velocity(after), with_clusters.velocity(after), atol=0.05)
    moved = [
        se3_inverse(one.pose(after)[0]) @ one.pose(after)[1] for one in (without, with_clusters)
    ]
    np.testing.assert_allclose(moved[0], moved[1], atol=0.01)
    deviations = (np.sqrt(one.covariance(t)[:, 3, 3]) for one in (without, with_clusters))
    np.testing.assert_allclose(*deviations, rtol=0.5)
    error = nees(without, motion, after)
    assert (np.array(error) < 22.5).all()
