"""Linearisation of every factor beside GTSAM's own of the same kind, and whole optimisations."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, L, U, V, X
from rich.table import Table

from benchmarks.factors_problem import (
    CAMERA,
    NOISE,
    QC,
    Array,
    Factors,
    Problem,
    as_graph,
    native_factors,
    native_stereo,
    our_factors,
    standard_problem,
    without_landmarks,
)
from benchmarks.turns import fastest
from factors import (
    GyroFactor,
    ImuFactor,
    InterpolatedFactor,
    InterpolatedStereoFactor,
    PointToPlaneFactor,
    StereoReprojectionFactor,
    WnoaPriorFactor,
    WnoaPriorFactorPose2,
    WnoaPriorFactorVector,
    WnojPriorFactor,
    optimize,
)
from factors.jacobian_blocks import Blocks

Pair = tuple[Any, Any]


def pairs(problem: Problem) -> dict[str, Pair]:
    """Ours and GTSAM's own, or None if GTSAM has none."""
    states = [gtsam.StateData(X(k), V(k), float(problem.times[k])) for k in range(2)]
    t = float(problem.times[:2].mean())
    at, between = {gtsam.StateData(X(900), V(900), t)}, set(states)
    one, three = (gtsam.noiseModel.Isotropic.Sigma(n, 0.1) for n in (1, 3))
    gps = gtsam.GPSFactor(X(900), np.zeros(3), three)
    stereo = native_stereo(problem, 0)
    at_t = gtsam.GenericStereoFactor3D(
        stereo.measured(), stereo.noiseModel(), X(900), L(0), stereo.calibration()
    )
    interpolated = gtsam.WnoaInterpFactorPose3
    plane = [gtsam.StateData(U(k), U(10 + k), states[k].time) for k in range(2)]
    points = [gtsam.StateData(U(20 + k), U(10 + k), states[k].time) for k in range(2)]
    qc, jerk = np.full(3, 0.1), [(X(k), V(k), V(500 + k), states[k].time) for k in range(2)]
    imu = gtsam.PreintegratedImuMeasurements(gtsam.PreintegrationParams.MakeSharedU(9.81))
    imu.integrateMeasurement(np.array([0, 0, 9.81]), np.zeros(3), states[1].time - states[0].time)
    on_plane = PointToPlaneFactor(np.ones(3), np.eye(3)[0], 1.0, one, 0)
    measured, camera = problem.measured[0], (L(0), CAMERA)
    return {
        "WnoaPriorFactor": (
            WnoaPriorFactor(*states, QC),
            gtsam.WnoaMotionFactorPose3(*states, QC),
        ),
        "WnoaPriorFactorPose2": (
            WnoaPriorFactorPose2(*plane, qc),
            gtsam.WnoaMotionFactorPose2(*plane, qc),
        ),
        "WnoaPriorFactorVector": (
            WnoaPriorFactorVector(*points, qc),
            gtsam.WnoaMotionFactorPoint3(*points, qc),
        ),
        "WnojPriorFactor": (WnojPriorFactor(*jerk, QC), None),
        "StereoReprojectionFactor": (
            StereoReprojectionFactor(measured, NOISE, X(0), *camera),
            stereo,
        ),
        "InterpolatedStereoFactor": (
            InterpolatedStereoFactor(measured, NOISE, *states, *camera, t),
            interpolated(at_t, between, at, QC, True),
        ),
        "InterpolatedFactor, GPS": (
            InterpolatedFactor(gps, *states, t),
            interpolated(gps, between, at, QC, True),
        ),
        "InterpolatedFactor, GPS, qc": (
            InterpolatedFactor(gps, *states, t, qc=QC),
            interpolated(gps, between, at, QC, False),
        ),
        "InterpolatedFactor, any inner factor": (
            InterpolatedFactor(at_t, *states, t),
            interpolated(at_t, between, at, QC, True),
        ),
        "InterpolatedFactor, plane": (InterpolatedFactor(on_plane, *states, t), None),
        "GyroFactor": (GyroFactor(np.zeros(3), three, V(0), B(0)), None),
        "ImuFactor": (
            ImuFactor(imu, *states, B(0)),
            gtsam.ImuFactor(X(0), U(20), X(1), U(21), B(0), imu),
        ),
    }


def all_factors(table: Table) -> None:
    """Linearisation of each factor, held by Python, at values that Python owns.

    The floor is a callback that reads the same variables in Python and returns zeros. Faster is
    only one that leaves reading to GTSAM.
    """
    problem = standard_problem(60)
    values = gtsam.Values(problem.start)
    for k in range(2):
        values.insert(U(k), gtsam.Pose2(0.1 * k, 0, 0))
        values.insert(U(10 + k), np.zeros(3))
        values.insert(U(20 + k), np.zeros(3))
        values.insert(V(500 + k), np.zeros(6))
    values.insert(B(0), gtsam.imuBias.ConstantBias())
    for name, (ours, native) in pairs(problem).items():
        contestants = {"ours": ours, "native": native}
        if isinstance(ours, gtsam.CustomFactor):
            contestants["floor"] = empty_factor(ours, values)
        calls: dict[str, Callable[[], object]] = {
            each: lambda factor=factor: factor.linearize(values)  # type: ignore[misc]
            for each, factor in contestants.items()
            if factor is not None
        }
        seconds = fastest(calls, rounds=30, each=60)
        shown = f"{1e6 * seconds['ours']:.1f}"
        for other in list(calls)[1:]:
            shown += f", {seconds['ours'] / seconds[other]:.1f} x {other}"
        if {"native", "floor"} <= calls.keys():
            shown += f" ({seconds['floor'] / seconds['native']:.1f} x native)"
        table.add_row(f"{name}, us", shown, "<= 2.5 x native")


def empty_factor(factor: gtsam.CustomFactor, values: gtsam.Values) -> gtsam.CustomFactor:
    """Make a factor that reads what another one does and returns zeros."""
    zeros, keys, rows = values.zeroVectors(), list(factor.keys()), factor.dim()
    blocks = Blocks(rows, tuple(len(zeros.at(key)) for key in keys))
    readers = [_reader(values, key) for key in keys]

    def error(_: object, values: gtsam.Values, jacobians: gtsam.JacobianVector | None) -> Array:
        for read in readers:
            read(values)
        if jacobians is not None:
            blocks.copy_to(jacobians)
        return blocks.error

    return gtsam.CustomFactor(factor.noiseModel(), keys, error)


def _reader(values: gtsam.Values, key: int) -> Callable[[gtsam.Values], Array]:
    """Return what reads the numbers of a variable, of whatever type it is."""
    readers: list[Callable[[gtsam.Values], Array]] = [
        lambda values: values.atPose3(key).matrix(),
        lambda values: values.atPose2(key).matrix(),
        lambda values: values.atVector6(key),
        lambda values: values.atPoint3(key),
        lambda values: values.atConstantBias(key).vector(),
    ]
    for read in readers:
        with suppress(RuntimeError):
            read(values)
            return read
    raise ValueError(f"no reader for {gtsam.DefaultKeyFormatter(key)}")


def whole_optimisations(table: Table) -> None:
    """Three steps of Levenberg-Marquardt: GTSAM's on its own factors, and `optimize` on ours."""
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setLinearSolverType("MULTIFRONTAL_QR")
    parameters.setMaxIterations(3)
    parameters.setRelativeErrorTol(0)
    parameters.setAbsoluteErrorTol(0)
    for states in (100, 2000):
        problem = standard_problem(states)
        native, ours = native_factors(problem), our_factors(problem)
        ratio = _of_native(native, ours, problem.start, parameters)
        table.add_row(f"LM by optimize to native, {states} states", f"{ratio:.2f}", "<= 1.7")
        chain = [[f for f in each if len(f.keys()) != 2] for each in (native, ours)]  # no stereo
        start = without_landmarks(problem.start, list(range(states)))
        ratio = _of_native(*chain, start, parameters)
        table.add_row("  without landmarks", f"{ratio:.2f}", "")
        ratio = _of_native(native, ours, problem.start, parameters, by_gtsam=True)
        table.add_row("  GTSAM's LM on ours to native", f"{ratio:.1f}", "")


def _of_native(
    native: Factors,
    ours: Factors,
    start: gtsam.Values,
    parameters: gtsam.LevenbergMarquardtParams,
    by_gtsam: bool = False,
) -> float:
    """Time of `optimize`, or of GTSAM's optimiser, on our factors to GTSAM's on its own."""
    theirs, graph, solver = as_graph(native), as_graph(ours), gtsam.LevenbergMarquardtOptimizer
    calls: dict[str, Callable[[], object]] = {
        "native": lambda: solver(theirs, start, parameters).optimize(),
        "ours": lambda: optimize(graph, start, parameters),
    }
    if by_gtsam:
        calls["ours"] = lambda: solver(graph, start, parameters).optimize()
    seconds = fastest(calls, rounds=1 if by_gtsam else 3, each=1)
    return seconds["ours"] / seconds["native"]
