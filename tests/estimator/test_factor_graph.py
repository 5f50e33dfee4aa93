"""The pieces that graphs are made of."""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from synthetic import CAMERA, TWIST, constant_velocity, tracklets

from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator.batch_graph import Window, gauss_newton
from gpvo.estimator.graph_builder import (
    SAME_TIME,
    FactorMaker,
    landmark_points,
    nested_dissection,
    state_times,
)
from gpvo.estimator.initialization import fused_velocity
from gpvo.mc_ransac import VelocityFit
from gpvo.tracking import Measurements, seen_twice
from gpvo.trajectory import States

MAKE = FactorMaker(CAMERA, NoiseConfig())


def window(noise: float = 0.3) -> Window:
    measurements = seen_twice(Measurements.concatenate(tracklets(clusters=4, noise=noise)))
    t = state_times(measurements.t, 0.0)
    states = States(t, constant_velocity(t), np.tile(TWIST, (len(t), 1)))
    return Window(states, measurements, np.diag(np.repeat([1e-6, 1.0], 6) ** 2))


@settings(deadline=None)
@given(
    arrays(np.float64, st.integers(0, 40), elements=st.floats(0, 1, width=32)),
    st.sampled_from([0.0, 1e-3, 0.1]),
    st.sampled_from([-np.inf, 0.0, 0.5]),
)
def test_state_times(t: np.ndarray, interval: float, after: float) -> None:
    states = state_times(t, interval, after)
    assert np.isin(states, t).all()
    gaps = np.diff(states, prepend=after)
    assert (gaps > SAME_TIME).all()
    assert (gaps[:-1] > interval).all()
    if len(t) and t.max() - after > SAME_TIME:
        assert t.max() - states[-1] <= SAME_TIME
    inside = t[t > after]
    if len(inside) and len(states):  # no measurement is farther from a state before it than this
        before = np.concatenate([[max(after, inside.min() - SAME_TIME)], states])
        distance = inside - before[np.searchsorted(before, inside, "right") - 1]
        assert (distance <= max(interval, SAME_TIME) + 1e-12).all()


def test_landmarks_are_triangulated_in_the_world() -> None:
    measurements = Measurements.concatenate(tracklets(clusters=4))
    poses = constant_velocity(measurements.t)
    points = dict(landmark_points(measurements, poses, CAMERA))
    assert sorted(points) == np.unique(measurements.landmark).tolist()
    local = CAMERA.triangulate(measurements.stereo)
    world = np.einsum("nij,nj->ni", poses[:, :3, :3], local) + poses[:, :3, 3]
    expected = np.array([points[index] for index in measurements.landmark.tolist()])
    assert np.allclose(world, expected, atol=1e-9)


def test_seen_twice_leaves_no_single_measurement() -> None:
    measurements = Measurements.concatenate(tracklets(clusters=4))
    kept = seen_twice(measurements)
    _, count = np.unique(kept.landmark, return_counts=True)
    assert (count >= 2).all()
    dropped = np.setdiff1d(measurements.landmark, kept.landmark)
    assert all((measurements.landmark == index).sum() == 1 for index in dropped)


def test_nested_dissection_orders_every_key_once_and_solves_the_same_system() -> None:
    problem = window()
    ordering = nested_dissection(range(len(problem.states)), problem.states.t, problem.measurements)
    graph, values = problem.graph(MAKE), problem.values(MAKE)
    keys = [ordering.at(position) for position in range(ordering.size())]
    assert sorted(keys) == sorted(values.keys())
    linear = graph.linearize(values)
    ours = linear.eliminateMultifrontal(ordering, gtsam.EliminateQR).optimize()
    colamd = gtsam.Ordering.Colamd(gtsam.VariableIndex(linear))
    theirs = linear.eliminateMultifrontal(colamd, gtsam.EliminateQR).optimize()
    assert ours.equals(theirs, 1e-7)


def test_gauss_newton_ends_at_a_stationary_point() -> None:
    problem, config = window(), EstimatorConfig(relative_decrease=1e-12, iterations=30)
    ordering = nested_dissection(range(len(problem.states)), problem.states.t, problem.measurements)
    graph = problem.graph(MAKE)
    values = gauss_newton(graph, problem.values(MAKE), ordering, config)
    step = graph.linearize(values).eliminateMultifrontal(ordering, gtsam.EliminateQR).optimize()
    assert max(np.abs(step.at(key)).max() for key in values.keys())  # noqa: SIM118 < 1e-6
    cost = graph.error(values)
    rng = np.random.default_rng(0)
    for _ in range(5):
        delta = gtsam.VectorValues()
        for key in values.keys():  # noqa: SIM118
            delta.insert(key, 1e-4 * rng.standard_normal(values_dimension(key)))
        assert graph.error(values.retract(delta)) > cost


def values_dimension(key: int) -> int:
    return 3 if chr(gtsam.symbolChr(key)) == "l" else 6


def test_joint_covariance_is_the_inverse_information() -> None:
    problem = window()
    coarse = state_times(problem.states.t, 0.05)
    small = Window(problem.states.at(coarse), problem.measurements[:0], problem.anchor_covariance)
    joint = small.joint_covariances(MAKE, len(coarse) - 1)
    keys = [key for k in range(len(coarse)) for key in (X(k), V(k))]
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(key)
    linear = small.graph(MAKE).linearize(small.values(MAKE))
    jacobian, _ = linear.jacobian(ordering)
    root = np.linalg.inv(np.linalg.qr(jacobian, "r"))
    covariance = root @ root.T
    for k, block in enumerate(joint):
        expected = covariance[12 * k : 12 * k + 24, 12 * k : 12 * k + 24]
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        assert np.abs((block - expected) / scale).max() < 1e-6


def test_fused_velocity_weighs_by_covariance() -> None:
    predicted, measured = np.zeros(6), np.ones(6)
    fit = VelocityFit(measured, np.eye(6), np.ones(0, bool))
    assert np.allclose(fused_velocity(predicted, np.eye(6), fit), 0.5)
    assert np.allclose(fused_velocity(predicted, 1e12 * np.eye(6), fit), 1.0)
    assert np.allclose(fused_velocity(predicted, 1e-12 * np.eye(6), fit), 0.0)
    assert np.array_equal(fused_velocity(predicted, np.eye(6), None), predicted)
