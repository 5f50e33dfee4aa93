"""After a break landmarks of before tell where the camera is: at once, late, or too far away."""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.simulated_tracklets import TrackletSimulation
from factors import StereoCamera
from factors.lie import se3_exp, se3_inverse, se3_log
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator import FixedLagSmoother
from gpvo.estimator.after_break import PATIENCE
from gpvo.estimator.gathered import GatheredMeasurements
from gpvo.estimator.known_place import KnownPlace, PoseInWorld
from gpvo.tracking import Measurements
from gpvo.trajectory import States

Array = NDArray[np.float64]

NOTHING = Measurements.concatenate([])
NOISE = NoiseConfig(track_drift=0.0, initial_velocity=0.3)
CONFIG = EstimatorConfig(bridge=0.3)
DT = 0.005


def turning(turn: Array, start: float, stop: float, duration: float) -> States:
    """A camera that moves sideways, and turns at rates (3,), rad/s, between two times."""
    t = DT * np.arange(round(duration / DT) + 1)
    twist = np.zeros((len(t), 6))
    twist[:, 3] = 0.1
    twist[(t >= start) & (t < stop), :3] = turn
    T = list(accumulate(se3_exp(DT * twist), np.matmul, initial=np.eye(4)))[: len(t)]
    return States(t, np.array(T), twist)


def error_of(smoother: FixedLagSmoother, motion: States) -> Array:
    """Error of the newest pose, rad and m."""
    latest = smoother.latest()
    assert latest is not None
    error = se3_log(se3_inverse(motion.query(np.array([latest.t]))[0][0]) @ latest.T_world_cam)
    return np.array([np.linalg.norm(error[:3]), np.linalg.norm(error[3:])])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("length", [0.5, 1.0, 2.0])
def test_a_large_turn_in_a_break_is_found(length: float, seed: int) -> None:
    """By 26 to 103 degrees around the optical axis, so that landmarks stay in view."""
    simulation = TrackletSimulation(NOISE, per_cluster=40, length=100)
    motion = turning(np.array([0.0, 0.0, 0.9]), 0.5, 0.5 + length, length + 0.9)
    smoother = FixedLagSmoother(simulation.camera, NOISE, CONFIG)
    known = 40 * round(0.5 / 0.05)
    for end_time, measurements in simulation.clusters(motion, np.random.default_rng(seed)):
        inside = 0.5 < end_time <= 0.5 + length + 1e-9
        seen = measurements[measurements.landmark < known]
        smoother.update(end_time, NOTHING if inside else seen)
    assert (error_of(smoother, motion) < 0.01).all()
    assert not any("indeterminate" in found.reason for found in smoother.diagnostics)


@pytest.mark.parametrize("late", [0.0, 0.1, 0.2])
def test_landmarks_that_are_known_again_later_are_waited_for(late: float) -> None:
    """Until then the same ones are tracked as new."""
    simulation = TrackletSimulation(NOISE, per_cluster=40, length=100)
    motion = turning(np.array([0.0, 0.0, 1.0]), 0.5, 1.5, 2.2)
    smoother = FixedLagSmoother(simulation.camera, NOISE, CONFIG)
    gathered = GatheredMeasurements(smoother, CONFIG)
    for end_time, measurements in simulation.clusters(motion, np.random.default_rng(3)):
        if 0.5 < end_time <= 1.5 + 1e-9:
            measurements = NOTHING
        elif 1.5 < end_time <= 1.5 + late + 1e-9:
            measurements = replace(measurements, landmark=measurements.landmark + 10_000)
        gathered.add(end_time, measurements, None)
    gathered.end()
    assert (error_of(smoother, motion) < 0.01).all()


def test_they_are_not_waited_for_long() -> None:
    simulation = TrackletSimulation(NOISE, per_cluster=40, length=100)
    motion = turning(np.zeros(3), 0.5, 1.5, 2.2)
    smoother = FixedLagSmoother(simulation.camera, NOISE, CONFIG)
    gathered = GatheredMeasurements(smoother, CONFIG)
    newest = {}
    for end_time, measurements in simulation.clusters(motion, np.random.default_rng(3)):
        if end_time > 0.5 + 1e-9:
            renamed = replace(measurements, landmark=measurements.landmark + 10_000)
            measurements = renamed if end_time > 1.5 + 1e-9 else NOTHING
        gathered.add(end_time, measurements, None)
        latest = smoother.latest()
        newest[round(end_time, 2)] = end_time - latest.t if latest is not None else np.inf
    assert max(newest.values()) == pytest.approx(PATIENCE, abs=0.051)
    assert newest[2.0] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    ("length", "ahead", "is_found"),
    [(0.5, 4.0, True), (0.5, 1.0, True), (0.5, -6.0, False), (0.5, 14.0, False), (5.0, 30.0, True)],
)
def test_a_place_is_within_reach(length: float, ahead: float, is_found: bool) -> None:
    """A street may look the same some metres on: at 8 m/s a camera does not turn back so soon."""
    rng, camera = np.random.default_rng(1), StereoCamera(200.0, 200.0, 160.0, 120.0, 0.3)
    before, here = se3_exp([0, 0, 0, 0, 0, 3.0]), se3_exp([0, 0, 0, 0, 0, 3.0 + ahead])
    speed = np.array([0.0, 0, 0, 0, 0, 8.0])
    measured = np.column_stack(
        [rng.uniform(0, 320, 30), rng.uniform(0, 240, 30), rng.uniform(3, 30, 30)]
    )
    points = camera.triangulate(measured) + here[:3, 3]
    number, zero = np.arange(30), np.zeros((6, 6))
    last = States(np.array([1.0]), before[None], speed[None])
    place = KnownPlace(number, points, PoseInWorld(before, zero), last)
    t = np.full(30, 1.0 + length)
    new = Measurements(number, np.zeros(30, np.int64), t, measured)
    found = place.pose(camera, NOISE, new, speed, np.array([0.1, 8.0]), 10)
    assert (found is not None) == is_found
    if found is not None:
        np.testing.assert_allclose(found.T_world_cam, here, atol=1e-6)
