"""The pieces that graphs are made of."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V, X
from synthetic import CAMERA, TWIST, constant_velocity, tracklets

from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator.batch_graph import Window, landmark_points, nested_dissection
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.graph_update import GraphUpdate, NumberedStates
from gpvo.estimator.isam2 import are_covariances, blocks_of_neighbours, prior_covariance
from gpvo.estimator.state_times import state_times
from gpvo.tracking import Measurements, seen_twice
from gpvo.trajectory import States

BUILD = GraphBuilder(CAMERA, NoiseConfig(), EstimatorConfig(relative_decrease=1e-12, iterations=30))


def window(noise: float = 0.3) -> Window:
    measurements = seen_twice(Measurements.concatenate(tracklets(clusters=4, noise=noise)))
    t = state_times(measurements.t, 0.0)
    states = States(t, constant_velocity(t), np.tile(TWIST, (len(t), 1)))
    return Window(states, measurements, np.diag(np.repeat([1e-6, 1.0], 6) ** 2))


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
    graph, values = problem.graph(BUILD), problem.values(BUILD)
    keys = [ordering.at(position) for position in range(ordering.size())]
    assert sorted(keys) == sorted(values.keys())
    linear = graph.linearize(values)
    ours = linear.eliminateMultifrontal(ordering, gtsam.EliminateQR).optimize()
    colamd = gtsam.Ordering.Colamd(gtsam.VariableIndex(linear))
    theirs = linear.eliminateMultifrontal(colamd, gtsam.EliminateQR).optimize()
    assert ours.equals(theirs, 1e-7)


def test_gauss_newton_ends_at_a_stationary_point() -> None:
    """States and landmarks: no step from there lowers the cost."""
    problem = window()
    best = Window(problem.optimize(BUILD), problem.measurements, problem.first_covariance)
    graph, values = problem.graph(BUILD), problem.values(BUILD)
    for k, (T, twist) in enumerate(zip(best.states.T_world_cam, best.states.twist, strict=True)):
        values.update(X(k), gtsam.Pose3(T))
        values.update(V(k), twist)
    for _ in range(5):  # of the landmarks, given the states
        values = values.retract(graph.linearize(values).optimize())
    moved = np.array([values.atPose3(X(k)).matrix() for k in range(len(best.states))])
    assert np.abs(moved - best.states.T_world_cam).max() < 1e-6
    cost = graph.error(values)
    rng = np.random.default_rng(0)
    for _ in range(5):
        delta = gtsam.VectorValues()
        for key in values.keys():  # noqa: SIM118
            delta.insert(key, 1e-4 * rng.standard_normal(values_dimension(key)))
        assert graph.error(values.retract(delta)) > cost


def values_dimension(key: int) -> int:
    return 3 if chr(gtsam.symbolChr(key)) == "l" else 6


def test_covariance_is_the_inverse_information() -> None:
    problem = window()
    coarse = state_times(problem.states.t, 0.05)
    small = Window(problem.states.at(coarse), problem.measurements[:0], problem.first_covariance)
    found = small.covariance(BUILD, len(coarse))
    ordering = gtsam.Ordering()
    for k in range(len(coarse)):
        ordering.push_back(X(k))
        ordering.push_back(V(k))
    linear = small.graph(BUILD).linearize(small.values(BUILD))
    jacobian, _ = linear.jacobian(ordering)
    root = np.linalg.inv(np.linalg.qr(jacobian, "r"))
    expected = root @ root.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((found - expected) / scale).max() < 1e-6
    count = len(coarse) - 1
    part = slice(12 * count)
    again = small.covariance(BUILD, count)
    assert np.abs((again - found[part, part]) / scale[part, part]).max() < 1e-6


def test_covariance_of_the_prior_alone_is_that_of_its_graph() -> None:
    """At rest, where the turn of the body on the way, which is neglected, is none."""
    t = np.array([0.0, 0.02, 0.05, 0.3])
    states = States(t, np.tile(np.eye(4), (4, 1, 1)), np.zeros((4, 6)))
    first = np.diag(np.repeat([1e-3, 1.0], 6) ** 2)
    alone = Window(states, Measurements.concatenate([]), first)
    expected = alone.covariance(BUILD, 4)
    found = prior_covariance(first, t, BUILD.qc.tolist())
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((found - expected) / scale).max() < 1e-6
    pairs = blocks_of_neighbours(found)
    assert pairs.shape == (3, 24, 24)
    assert np.array_equal(pairs[2], found[24:, 24:])
    assert are_covariances(pairs)


@pytest.mark.parametrize("fault", ["negative", "not finite", "indefinite"])
def test_what_is_no_covariance_is_found(fault: str) -> None:
    matrices = np.tile(np.diag([1e-12, 1.0, 1e12]), (4, 1, 1))
    assert are_covariances(matrices)
    matrices[2, 0, 0] = {"negative": -1e-12, "not finite": np.nan, "indefinite": 1e-12}[fault]
    if fault == "indefinite":
        matrices[2, 0, 1] = matrices[2, 1, 0] = 1.1e-6
    assert not are_covariances(matrices)


def test_numbered_states_are_cut_where_states_leave() -> None:
    window_states = NumberedStates(
        7, States(np.arange(4.0), np.tile(np.eye(4), (4, 1, 1)), np.zeros((4, 6)))
    )
    assert list(window_states.numbers) == [7, 8, 9, 10]
    assert window_states.before(2.0) == 2
    assert list(window_states.after(2).numbers) == [9, 10]
    assert list(window_states.until(2).numbers) == [7, 8]
    update = GraphUpdate()
    update.add_states(window_states.after(3))
    assert dict(update.stamps) == {X(10): 3.0, V(10): 3.0}
    assert sorted(update.values.keys()) == sorted([X(10), V(10)])
