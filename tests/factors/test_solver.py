"""The factors inside optimisers: ours, GTSAM's own, and far from any solution."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from graphs import CAMERA, NOISE, QC, pose_between, random_states, seeds
from gtsam.symbol_shorthand import L, V, X
from hypothesis import given, settings
from hypothesis import strategies as st

from factors import StructurelessStereoFactor, WnoaPriorFactor, optimize
from factors.lie import se3_inverse
from factors.wnoa import wnoa_error

ROBUST = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(1.345), NOISE)


@given(seeds, st.floats(-6, -1))
@settings(deadline=None, max_examples=15)
def test_the_prior_keeps_the_correlation_of_pose_and_velocity(seed: int, exponent: float) -> None:
    """Down to a microsecond, where GTSAM's own noise model turns diagonal."""
    dt = 10.0**exponent
    values = random_states(seed, dt)
    T_i, T_j = (values.atPose3(X(k)).matrix() for k in range(2))
    v_i, v_j = (values.atVector(V(k)) for k in range(2))
    error = wnoa_error(T_i, v_i, T_j, v_j, dt)[0].astype(np.longdouble)
    p, v = error[:6], error[6:]
    cost = np.sum((12 * p**2 / dt**3 - 12 * p * v / dt**2 + 4 * v**2 / dt) / QC) / 2
    factor = WnoaPriorFactor(X(0), V(0), X(1), V(1), dt, QC)
    np.testing.assert_allclose(factor.error(values), float(cost), rtol=1e-9)


def problem(model: gtsam.noiseModel.Base) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Two states, tied to each other and to a start, that see five landmarks."""
    rng, dt = np.random.default_rng(5), 0.05
    truth = random_states(5, dt)
    graph = gtsam.NonlinearFactorGraph()
    tight = gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)
    graph.add(gtsam.PriorFactorPose3(X(0), truth.atPose3(X(0)), tight))
    graph.add(WnoaPriorFactor(X(0), V(0), X(1), V(1), dt, QC))
    states = [(X(0), V(0), 0.0), (X(1), V(1), dt)]
    for _ in range(5):
        times = np.sort(rng.uniform(0, dt, 6))
        poses = pose_between(truth, 0.0, dt, times)
        point = poses[0] @ np.r_[rng.uniform(-1, 1, 2), rng.uniform(2, 4), 1.0]
        measured = CAMERA.project((se3_inverse(poses) @ point)[:, :3])
        measured += rng.normal(size=measured.shape) * 0.3
        graph.add(StructurelessStereoFactor(measured, times, 0, model, states, CAMERA))
    start = gtsam.Values(truth)
    start.erase(L(0))
    start.update(X(1), truth.atPose3(X(1)).retract(rng.normal(size=6) * 0.01))
    return graph, start


@pytest.mark.parametrize("model", [NOISE, ROBUST], ids=["gaussian", "robust"])
def test_gtsams_optimiser_agrees(model: gtsam.noiseModel.Base) -> None:
    graph, start = problem(model)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setLinearSolverType("MULTIFRONTAL_QR")
    parameters.setRelativeErrorTol(1e-12)
    parameters.setAbsoluteErrorTol(1e-12)
    gtsams = gtsam.LevenbergMarquardtOptimizer(graph, start, parameters).optimize()
    ours = optimize(graph, start, max_iterations=100, tolerance=1e-13)
    assert graph.error(ours) < graph.error(start)
    np.testing.assert_allclose(graph.error(ours), graph.error(gtsams), rtol=1e-8)
    for k in range(2):
        assert ours.atPose3(X(k)).equals(gtsams.atPose3(X(k)), 1e-4)
    assert start.equals(problem(model)[1], 0.0)


def test_divergence_is_an_error_not_a_result() -> None:
    graph, start = problem(NOISE)
    start.update(V(0), np.full(6, np.nan))
    with pytest.raises(ValueError, match="values"):
        optimize(graph, start)


@pytest.mark.parametrize("model", [NOISE, ROBUST], ids=["gaussian", "robust"])
def test_a_landmark_behind_the_camera_stays_finite(model: gtsam.noiseModel.Base) -> None:
    """A half turn between the measurements: no state of the landmark suits them all."""
    graph, values = problem(model)
    half_turn = gtsam.Pose3(gtsam.Rot3.Ry(np.pi - 0.01), np.zeros(3))
    values.update(X(1), values.atPose3(X(1)).compose(half_turn))
    A, b = graph.linearize(values).jacobian()
    assert np.isfinite(A).all()
    assert np.isfinite(b).all()
    assert np.isfinite(graph.error(values))
