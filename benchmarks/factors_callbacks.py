"""What it costs to linearise single factors, beside GTSAM's native ones."""

from __future__ import annotations

from collections.abc import Callable
from itertools import cycle

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from rich.table import Table

from benchmarks.factors_problem import (
    CAMERA,
    NATIVE_CAMERA,
    NATIVE_NOISE,
    NOISE,
    QC,
    ROBUST,
    Array,
    Factors,
    as_graph,
    native_factors,
    our_factors,
    standard_problem,
    without_landmarks,
)
from benchmarks.turns import fastest
from factors import (
    InterpolatedStereoFactor,
    StereoReprojectionFactor,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    extrapolate,
)
from factors.jacobian_blocks import Blocks
from factors.lie import se3_inverse


def single_factors(table: Table) -> None:
    """Linearisation of one factor."""
    problem = standard_problem(60)
    values = problem.start
    prior = WnoaPriorFactor(X(0), V(0), X(1), V(1), problem.times[1] - problem.times[0], QC)
    stereo = StereoReprojectionFactor(problem.measured[0], NOISE, X(0), L(0), CAMERA)
    keys = X(0), V(0), X(1), V(1), L(0)
    t_i, t_j = problem.times[:2]
    between = InterpolatedStereoFactor(
        problem.measured[0], NOISE, *keys, CAMERA, t_i, t_j, (t_i + t_j) / 2
    )
    native = native_factors(problem)
    ours, robust = (landmark_of_ten(model) for model in (NOISE, ROBUST))
    own_states = landmark_of_ten(NOISE, QC)
    theirs, fixed = native_of_ten(False), native_of_ten(True)
    one_by_one, at_once = empty_factors(list(keys[:4]))
    own = without_landmarks(values, list(range(60)))
    seconds = fastest(
        {
            "native prior": lambda: native[2].linearize(values),
            "one by one": lambda: one_by_one.linearize(values),
            "at once": lambda: at_once.linearize(values),
            "prior": lambda: prior.linearize(values),
            "native stereo": lambda: native[-60].linearize(values),
            "stereo": lambda: stereo.linearize(values),
            "interpolated": lambda: between.linearize(values),
            "native 10": lambda: [factor.linearize(values) for factor in theirs],
            "native 10, fixed noise": lambda: [factor.linearize(values) for factor in fixed],
            "one landmark": in_turns(ours, own),
            "robust": in_turns(robust, own),
            "own states": in_turns(own_states, own),
        },
        rounds=15,
        each=60,
    )
    us = {name: 1e6 * s for name, s in seconds.items()}
    table.add_row("an empty callback, four blocks one by one, us", f"{us['one by one']:.1f}", "")
    table.add_row("  four blocks at once, us", f"{us['at once']:.1f}", "")
    table.add_row("WnoaPriorFactor, us", f"{us['prior']:.1f}", "")
    table.add_row("  to native", f"{us['prior'] / us['native prior']:.2f}", "<= 2.5")
    table.add_row("StereoReprojectionFactor, us", f"{us['stereo']:.1f}", "<= 15")
    table.add_row("InterpolatedStereoFactor, us", f"{us['interpolated']:.1f}", "")
    name = "structureless factor of one landmark, 10 measurements, us"
    table.add_row(name, f"{us['one landmark']:.1f}", "")
    for name in ("native 10", "native 10, fixed noise"):
        table.add_row(f"  {name} factors to it", f"{us[name] / us['one landmark']:.2f}", "")
    table.add_row("  with Huber's loss, us", f"{us['robust']:.1f}", "")
    table.add_row("  with Q_c, each time a state of its own, us", f"{us['own states']:.1f}", "")


def empty_factors(keys: list[int]) -> Factors:
    """What a prior in Python costs without its arithmetic, by how it returns its derivatives."""
    zeros, blocks = np.zeros((12, 6)), Blocks(12, (6, 6, 6, 6))

    def one_by_one(_this: object, _values: object, jacobians: gtsam.JacobianVector) -> Array:
        for block in range(4):
            jacobians[block] = zeros
        return zeros[:, 0]

    def at_once(_this: object, _values: object, jacobians: gtsam.JacobianVector) -> Array:
        blocks.copy_to(jacobians)
        return zeros[:, 0]

    unit = gtsam.noiseModel.Unit.Create(12)
    return [gtsam.CustomFactor(unit, keys, callback) for callback in (one_by_one, at_once)]


def measurements_of_ten() -> tuple[Array, Array, list[tuple[int, int, float]]]:
    """Ten measurements at their own times between two states of the standard problem."""
    problem = standard_problem(60)
    states = [(X(k), V(k), float(problem.times[k])) for k in (0, 4)]
    times = np.linspace(states[0][2], states[1][2], 12)[1:-1]
    poses = extrapolate(problem.truth[0], problem.velocities[0], times - states[0][2]).pose
    points = se3_inverse(poses) @ np.r_[problem.points[0], 1.0]
    return CAMERA.project(points[:, :3]) + 0.3, times, states


def landmark_of_ten(
    model: gtsam.noiseModel.Base, qc: Array | None = None
) -> StructurelessStereoFactor:
    """One landmark's ten measurements without the landmark."""
    measured, times, states = measurements_of_ten()
    return StructurelessStereoFactor(measured, times, 0, model, states, CAMERA, qc)


def in_turns(factor: StructurelessStereoFactor, values: gtsam.Values) -> Callable[[], object]:
    """Linearise at the values and at others: the factor keeps what it found for the last ones."""
    moved = gtsam.Values(values)
    key = factor.keys()[0]
    moved.update(key, values.atPose3(key).retract(np.full(6, 1e-3)))
    turns = cycle((values, moved))
    return lambda: factor.linearize(next(turns))


def native_of_ten(fixed_noise: bool) -> Factors:
    """GTSAM's own; by default each adds the deviation between the states to its noise."""
    measured, times, states = measurements_of_ten()
    estimated = {gtsam.StateData(*state) for state in states}
    factors = []
    for n, (u, v, disparity) in enumerate(measured):
        at = gtsam.StateData(X(1000 + n), V(1000 + n), times[n])
        point = gtsam.StereoPoint2(u, u - disparity, v)
        inner = gtsam.GenericStereoFactor3D(point, NATIVE_NOISE, at.pose, L(0), NATIVE_CAMERA)
        factors.append(gtsam.WnoaInterpFactorPose3(inner, estimated, {at}, QC, fixed_noise))
    return factors


def growth(table: Table) -> None:
    """The cost of linearising does not grow with the number of variables."""
    costs = {}
    for states in (100, 5000):
        problem = standard_problem(states)
        graph = as_graph(our_factors(problem)[2:102])
        costs[states] = lambda graph=graph, values=problem.start: graph.linearize(values)
    seconds = fastest({str(n): call for n, call in costs.items()}, rounds=10, each=3)
    ratio = seconds["5000"] / seconds["100"]
    table.add_row("100 factors, 10 001 variables to 221", f"{ratio:.2f}", "1")
