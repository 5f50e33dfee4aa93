"""The trajectory through a graph's states: means, covariances and derivatives at any time."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import QC, derivative, random_states, seeds, state
from gtsam.symbol_shorthand import V, X
from hypothesis import given, settings
from numpy.typing import NDArray

from factors import GaussianProcess, WnoaPriorFactor, extrapolate, interpolate, isam2_parameters
from factors.lie import se3_inverse, se3_log

Array = NDArray[np.float64]

COUNT = 5
examples = settings(deadline=None, max_examples=10)


def states_of(dt: float, count: int = COUNT) -> list[gtsam.StateData]:
    return [gtsam.StateData(X(k), V(k), 1.0 + k * dt) for k in range(count)]


def graph_of(values: gtsam.Values, states: list[gtsam.StateData]) -> gtsam.NonlinearFactorGraph:
    """Every pose measured to 10 mrad and 10 mm, and the motion prior."""
    graph, noise = gtsam.NonlinearFactorGraph(), gtsam.noiseModel.Isotropic.Sigma(6, 0.01)
    for each in states:
        graph.add(gtsam.PriorFactorPose3(each.pose, values.atPose3(each.pose), noise))
    for one, next_one in pairwise(states):
        graph.add(WnoaPriorFactor(one, next_one, QC))
    return graph


@given(seeds)
@examples
def test_it_interpolates_between_the_states_and_goes_on_beyond(seed: int) -> None:
    dt = 0.1
    values, states = random_states(seed, dt, COUNT), states_of(dt)
    order = np.random.default_rng(seed).permutation(COUNT)
    trajectory = GaussianProcess([states[k] for k in order], values, QC)
    t = np.array([[1.0, 1.17, 1.2], [1.4, 0.9, 1.55]])
    poses, twists = trajectory.pose(t), trajectory.velocity(t)
    assert poses.shape == (2, 3, 4, 4) and twists.shape == (2, 3, 6)
    between = interpolate(*state(values, 1), *state(values, 2), 1.1, 1.2, 1.17)
    before, after = extrapolate(*state(values, 0), -0.1), extrapolate(*state(values, 4), 0.15)
    np.testing.assert_allclose(poses[0, 0], state(values, 0)[0], atol=1e-13)
    np.testing.assert_allclose(poses[0, 2], state(values, 2)[0], atol=1e-13)
    np.testing.assert_allclose(poses[1, 0], state(values, 4)[0], atol=1e-13)
    for n, found in (((0, 1), between), ((1, 1), before), ((1, 2), after)):
        np.testing.assert_allclose(poses[n], found.pose, atol=1e-13)
        np.testing.assert_allclose(twists[n], found.velocity, atol=1e-12)
    np.testing.assert_array_equal(trajectory.pose(1.17), poses[0, 1])
    assert trajectory.pose([]).shape == (0, 4, 4)


@given(seeds)
@examples
def test_derivatives_are_those_of_the_border_states(seed: int) -> None:
    dt = 0.2
    values, states = random_states(seed, dt, 3), states_of(dt, 3)
    times = np.array([0.93, 1.0, 1.07, 1.2, 1.31, 1.4, 1.5])
    border, jacobians = GaussianProcess(states, values, QC).derivatives(times)
    np.testing.assert_array_equal(border, [0, 0, 0, 1, 1, 1, 1])
    here = GaussianProcess(states, values, QC)
    T, v = here.pose(times), here.velocity(times)

    def moved(changed: gtsam.Values) -> Array:
        there = GaussianProcess(states, changed, QC)
        return np.hstack([se3_log(se3_inverse(T) @ there.pose(times)), there.velocity(times) - v])

    numerical = {
        key: derivative(moved, values, key, 1e-3) for k in range(3) for key in (X(k), V(k))
    }
    for n, (i, jacobian) in enumerate(zip(border.tolist(), jacobians, strict=True)):
        keys = X(i), V(i), X(i + 1), V(i + 1)
        expected = np.hstack([numerical[key][n] for key in keys])
        np.testing.assert_allclose(jacobian, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("dt", [0.1, 1e-3, 1e-5, 1e-6])
def test_covariance_is_that_of_a_state_put_in(dt: float) -> None:
    """Of states that the graph has, but that are not given as states of the trajectory."""
    values, states = random_states(2, dt, COUNT), states_of(dt)
    for left_out in (0, 2, 4):
        given_states = [each for k, each in enumerate(states) if k != left_out]
        middle = GaussianProcess(given_states, values, QC)
        t = 1.0 + left_out * dt
        at_mean = gtsam.Values(values)
        at_mean.update(X(left_out), gtsam.Pose3(middle.pose(t)))
        at_mean.update(V(left_out), middle.velocity(t))
        graph = graph_of(at_mean, states)
        graph.remove(left_out)  # nothing is measured there
        left = gtsam.NonlinearFactorGraph()
        for k in range(graph.size()):
            if graph.at(k) is not None:
                left.push_back(graph.at(k))
        found = GaussianProcess(given_states, at_mean, QC, left).covariance(t)
        whole = GaussianProcess(states, at_mean, QC, left).covariance(t)
        sigmas = np.sqrt(np.diag(whole))
        tolerance = max(1e-9, 2e-15 / dt**2)
        difference = (found - whole) / np.outer(sigmas, sigmas)
        assert np.abs(difference).max() < tolerance
        assert np.linalg.eigvalsh(found / np.outer(sigmas, sigmas))[0] > -1e-13


def test_whatever_knows_the_covariances_gives_the_same() -> None:
    dt = 0.1
    values, states = random_states(1, dt, COUNT), states_of(dt)
    graph, t = graph_of(values, states), np.linspace(0.95, 1.45, 11)
    isam = gtsam.ISAM2(isam2_parameters())
    isam.update(graph, values)
    smoother = gtsam.IncrementalFixedLagSmoother(10.0, isam2_parameters())
    stamps = {key: each.time for each in states for key in (each.pose, each.velocity)}
    smoother.update(graph, values, stamps)
    expected = GaussianProcess(states, values, QC, graph).covariance(t)
    sources: list[Any] = [gtsam.Marginals(graph, values), isam, smoother]
    for marginals in sources:
        found = GaussianProcess(states, values, QC, marginals).covariance(t)
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-12)


def test_bad_input_is_refused_by_name() -> None:
    values, states = random_states(0, 0.1, 3), states_of(0.1, 3)
    small = gtsam.Values(values)
    small.erase(V(1))
    small.insert(V(1), np.zeros(3))
    missing = gtsam.Values(values)
    missing.erase(X(2))
    without = GaussianProcess(states, values, QC)
    knows_two = GaussianProcess(states, values, QC, graph_of(missing, states[:2]))
    calls: list[tuple[str, Any]] = [
        ("states must be two", lambda: GaussianProcess(states[:1], values, QC)),
        ("states must be two", lambda: GaussianProcess([states[0]] * 2, values, QC)),
        ("v1 .* must be a vector of 6", lambda: GaussianProcess(states, small, QC)),
        ("key of", lambda: GaussianProcess([*states, (X(0), V(3), 9.0)], values, QC)),
        ("x2", lambda: GaussianProcess(states, missing, QC)),
        ("qc", lambda: GaussianProcess(states, values, -QC)),
        ("t must be finite", lambda: without.pose(np.nan)),
        ("marginals must be given", lambda: without.covariance(1.0)),
        ("marginals must know", lambda: GaussianProcess(states, values, QC, "Marginals")),  # type: ignore[arg-type]
        ("no covariance of x1 v1 x2 v2", lambda: knows_two.covariance(1.15)),
    ]
    for name, call in calls:
        with pytest.raises(ValueError, match=name):
            call()


@pytest.mark.parametrize("solved", [False, True])
def test_a_pose_that_is_fixed_has_no_covariance(solved: bool) -> None:
    """As with a very tight prior: GTSAM's joint covariance has the variance 1 there."""
    values, states, t = random_states(3, 0.1, COUNT), states_of(0.1), np.array([1.0, 1.04, 1.25])
    noise, found = gtsam.noiseModel, []
    for fixed in (noise.Constrained.All(6), noise.Isotropic.Sigma(6, 1e-6)):
        graph = graph_of(values, states)
        graph.add(gtsam.PriorFactorPose3(X(0), values.atPose3(X(0)), fixed))
        marginals: Any = gtsam.Marginals(graph, values) if solved else graph
        found.append(GaussianProcess(states, values, QC, marginals).covariance(t))
    assert not found[0][0, :6].any()
    np.testing.assert_allclose(found[0], found[1], rtol=1e-5, atol=1e-9)


def test_a_pose_that_is_fixed_in_part_is_refused() -> None:
    """GTSAM's covariance of it is wrong."""
    values, states = random_states(3, 0.1, COUNT), states_of(0.1)
    sigmas = np.array([0.1, 0.1, 0.1, 0.0, 0.1, 0.1])
    noise = gtsam.noiseModel.Constrained.MixedSigmas(6, sigmas)
    graph = graph_of(values, states)
    graph.add(gtsam.PriorFactorPose3(X(0), values.atPose3(X(0)), noise))
    with pytest.raises(ValueError, match="x0, which Constrained noise fixes in part"):
        GaussianProcess(states, values, QC, graph).covariance(1.04)
