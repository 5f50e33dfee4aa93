"""The factors inside optimisers: ours, GTSAM's own, and far from any solution."""

from __future__ import annotations

import gc
import weakref
from itertools import pairwise
from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import CAMERA, NOISE, QC, pose_between, random_states, seeds
from gtsam.symbol_shorthand import L, V, X
from hypothesis import given, settings
from hypothesis import strategies as st

from factors import (
    Iteration,
    StereoReprojectionFactor,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    fixed_lag_smoother,
    gauss_newton_parameters,
    isam2,
    optimize,
)
from factors.lie import se3_inverse
from factors.wnoa import wnoa_error

UNIT = gtsam.noiseModel.Isotropic.Sigma(6, 1.0)
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
    ours = optimize(graph, start, gauss_newton_parameters(100, 1e-13))
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


def far_away() -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Landmarks seen from poses that are far from where they start, so that full steps fail."""
    graph, start = problem(NOISE)
    rng, point = np.random.default_rng(11), np.array([0.4, -0.2, 1.5])
    start.insert(X(2), start.atPose3(X(0)).retract(rng.normal(size=6)))
    start.insert(L(1), start.atPose3(X(0)).transformFrom(5 * point))
    graph.add(StereoReprojectionFactor(CAMERA.project(point), NOISE, X(0), L(1), CAMERA))
    loose = gtsam.noiseModel.Isotropic.Sigma(6, 0.3)
    graph.add(gtsam.BetweenFactorPose3(X(0), X(2), gtsam.Pose3(), loose))
    graph.add(StereoReprojectionFactor(CAMERA.project(point), NOISE, X(2), L(1), CAMERA))
    return graph, start


def tight(parameters: Any) -> Any:
    parameters.setLinearSolverType("MULTIFRONTAL_QR")
    parameters.setRelativeErrorTol(1e-12)
    parameters.setAbsoluteErrorTol(1e-12)
    return parameters


def fixed_factor(parameters: Any) -> Any:
    parameters.setUseFixedLambdaFactor(False)
    return parameters


def diagonal(parameters: Any) -> Any:
    parameters.setDiagonalDamping(True)
    return parameters


@pytest.mark.parametrize(
    ("parameters", "theirs"),
    [
        (gtsam.LevenbergMarquardtParams(), gtsam.LevenbergMarquardtOptimizer),
        (fixed_factor(gtsam.LevenbergMarquardtParams()), gtsam.LevenbergMarquardtOptimizer),
        (diagonal(gtsam.LevenbergMarquardtParams()), gtsam.LevenbergMarquardtOptimizer),
        (gtsam.DoglegParams(), gtsam.DoglegOptimizer),
    ],
    ids=["fixed factor", "adapted factor", "diagonal", "dogleg"],
)
def test_damped_steps_are_those_of_gtsam(parameters: Any, theirs: Any) -> None:
    """The same errors iteration by iteration, and the same optimum."""
    graph, start = far_away()
    parameters = tight(parameters)
    report: list[Iteration] = []
    ours = optimize(graph, start, parameters, report=report)
    native = theirs(graph, start, parameters)
    errors = []
    for _ in range(3):
        native.iterate()
        errors.append(native.error())
    np.testing.assert_allclose([each.error for each in report[:3]], errors, rtol=1e-6)
    found = theirs(graph, start, parameters).optimize()
    np.testing.assert_allclose(graph.error(ours), graph.error(found), rtol=1e-6)
    assert graph.error(ours) < 0.9 * graph.error(start)
    assert all(b.error <= a.error for a, b in pairwise(report))
    assert report[-1].error == graph.error(ours)
    assert start.equals(far_away()[1], 0.0)


def test_damping_goes_on_where_the_start_is_not_determined() -> None:
    """A landmark that no one sees well: full steps fail, damped ones leave it where it is."""
    graph, start = problem(NOISE)
    start.insert(L(5), np.zeros(3))
    one_way = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.1, 1e12, 1e12]))
    graph.add(gtsam.PriorFactorPoint3(L(5), np.ones(3), one_way))
    report: list[Iteration] = []
    found = optimize(graph, start, tight(gtsam.LevenbergMarquardtParams()), report=report)
    np.testing.assert_allclose(found.atPoint3(L(5)), [1, 0, 0], atol=1e-3)
    assert report[-1].error < report[0].error


def test_parameters_of_no_method_are_refused() -> None:
    graph, start = problem(NOISE)
    with pytest.raises(ValueError, match="parameters must be GTSAM's"):
        optimize(graph, start, 20)  # type: ignore[arg-type]


def test_a_refused_update_leaves_the_smoother_as_it_was() -> None:
    """An error inside GTSAM's update would not."""
    dt, values = 0.05, random_states(1, 0.05, 4)
    smoother = fixed_lag_smoother(1.0)
    for k in range(3):
        graph, new = gtsam.NonlinearFactorGraph(), gtsam.Values()
        new.insert(X(k), values.atPose3(X(k)))
        new.insert(V(k), values.atVector(V(k)))
        graph.add(gtsam.PriorFactorPose3(X(k), values.atPose3(X(k)), UNIT))
        if k:
            graph.add(WnoaPriorFactor(X(k - 1), V(k - 1), X(k), V(k), dt, QC))
        stamps = {X(k): k * dt, V(k): k * dt}
        if k == 2:
            wrong, again = gtsam.Values(), gtsam.Values()
            again.insert(X(1), gtsam.Pose3())
            wrong.insert(X(2), values.atPose3(X(2)))
            wrong.insert(V(2), np.zeros(3))
            for fault, arguments in (
                (r"v2 .velocity_j. must be", (graph, wrong, stamps)),
                ("v2 must have a time", (graph, new, {X(2): 0.1})),
                ("v2 must have a time", (graph, new)),
                ("x1 is in the solver", (graph, again, {X(1): dt})),
            ):
                with pytest.raises(ValueError, match=fault):
                    smoother.update(*arguments)
        smoother.update(graph, new, stamps)
    for _ in range(5):
        smoother.update()
    estimate = smoother.calculateEstimate()
    graph, _ = gtsam.NonlinearFactorGraph(), None
    for k in range(3):
        graph.add(gtsam.PriorFactorPose3(X(k), values.atPose3(X(k)), UNIT))
    for k in range(2):
        graph.add(WnoaPriorFactor(X(k), V(k), X(k + 1), V(k + 1), dt, QC))
    expected = optimize(graph, values)
    for k in range(3):
        assert estimate.atPose3(X(k)).equals(expected.atPose3(X(k)), 1e-4)


def test_a_held_solver_copies_no_values_and_is_freed() -> None:
    seen: set[int] = set()

    def error(_: object, values: gtsam.Values, jacobians: Any) -> Any:
        seen.add(id(values))
        if jacobians is not None:
            jacobians[0] = np.eye(1)
        return values.atVector(V(0))

    solver, values = isam2(), gtsam.Values()
    graph = gtsam.NonlinearFactorGraph()
    for _ in range(20):
        graph.add(gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(1), [V(0)], error))
    values.insert(V(0), np.ones(1))
    seen_by_check = 1
    solver.update(graph, values)
    assert len(seen) <= 1 + seen_by_check
    gone = weakref.ref(solver)
    del solver
    gc.collect()
    assert gone() is None
    with pytest.raises(ValueError, match="lag"):
        fixed_lag_smoother(0.0)
    with pytest.raises(ValueError, match="lag"):
        fixed_lag_smoother("a second")  # type: ignore[arg-type]


def test_time_stamps_are_named_as_gtsam_names_them_and_finite() -> None:
    solver, values = fixed_lag_smoother(1.0), random_states(1, 0.05)
    graph = gtsam.NonlinearFactorGraph()
    for k in range(2):
        graph.add(gtsam.PriorFactorPose3(X(k), values.atPose3(X(k)), UNIT))
    some = gtsam.Values()
    for k in range(2):
        some.insert(X(k), values.atPose3(X(k)))
    with pytest.raises(ValueError, match="the time of x1 must be a finite number"):
        solver.update(graph, some, timestamps={X(0): 0.0, X(1): np.inf})
    solver.update(graph, some, timestamps={X(0): 0.0, X(1): 0.1})
    assert solver.calculateEstimate().size() == 2
