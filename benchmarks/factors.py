"""Speed of the factors, as ratios to GTSAM's native ones from one interleaved run.

Run as ``python -m benchmarks.factors``, with a file name for a plot of the cost per state. Each
time is the fastest of many rounds in which all contestants take turns, so that other load on the
machine meets them alike.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from factors import (
    InterpolatedStereoFactor,
    StereoCamera,
    StereoReprojectionFactor,
    TrackletFactor,
    WnoaPriorFactor,
    extrapolate,
    interpolate,
    optimize,
)
from factors.jacobians import JacobianBlocks
from factors.lie import se3_exp, se3_inverse

Array = NDArray[np.float64]
Factors = list[gtsam.NonlinearFactor]
Call = Callable[[], object]

CAMERA = StereoCamera(226.0, 226.0, 173.0, 130.0, 0.1)
NATIVE_CAMERA = gtsam.Cal3_S2Stereo(226.0, 226.0, 0.0, 173.0, 130.0, 0.1)
QC = 1 / (50 * np.array([10.0, 10, 10, 1, 1, 1]))  # the paper's, rotation first
SIGMAS = 1 / np.sqrt(0.1 * np.array([5.0, 5, 1]))  # of (u_left, v, disparity), the paper's
NOISE = gtsam.noiseModel.Diagonal.Sigmas(SIGMAS)
ROBUST = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(1.345), NOISE)
_MIX = np.array([[1.0, 0, 0], [1, 0, -1], [0, 1, 0]])  # (u_left, u_right, v)
NATIVE_NOISE = gtsam.noiseModel.Gaussian.Covariance(_MIX @ np.diag(SIGMAS**2) @ _MIX.T)


@dataclass
class Problem:
    """Noisy stereo measurements of landmarks from a moving camera, with a start to solve from."""

    times: Array
    truth: Array
    velocities: Array
    landmark: NDArray[np.int64]
    measured: Array
    points: Array
    start: gtsam.Values = field(default_factory=gtsam.Values)


def standard_problem(
    states: int, interval: float = 5e-3, seen: int = 5, active: int = 5, seed: int = 0
) -> Problem:
    """One measurement at each of `states` unique times about an interval (seconds) apart.

    Each landmark is seen `seen` times; `active` landmarks take turns.
    """
    rng = np.random.default_rng(seed)
    times = np.cumsum(interval * rng.uniform(0.4, 1.6, states)).round(6)
    truth, velocities = np.empty((states, 4, 4)), np.empty((states, 6))
    T, v = np.eye(4), np.array([0.1, 0.2, 0.05, 0.3, 0.1, 0.2])
    for k in range(states):
        truth[k], velocities[k] = T, v
        dt = times[min(k + 1, states - 1)] - times[k]
        v = v + rng.normal(size=6) * np.sqrt(QC * dt)
        T = T @ se3_exp(dt * v)
    group, turn = np.divmod(np.arange(states), seen * active)
    landmark = group * active + turn % active
    points = np.empty((landmark.max() + 1, 3))
    measured = np.empty((states, 3))
    for k, n in enumerate(landmark):
        if k == np.flatnonzero(landmark == n)[0]:
            ray = np.r_[rng.uniform(-0.6, 0.6, 2), 1.0] * rng.uniform(1.5, 5)
            points[n] = (truth[k] @ np.r_[ray, 1.0])[:3]
        seen_from = (se3_inverse(truth[k]) @ np.r_[points[n], 1.0])[:3]
        measured[k] = CAMERA.project(seen_from) + rng.normal(size=3) * SIGMAS * 0.5
    measured[:, 2] = np.maximum(measured[:, 2], 0.5)
    problem = Problem(times, truth, velocities, landmark, measured, points)
    for k in range(states):
        problem.start.insert(X(k), gtsam.Pose3(truth[k] @ se3_exp(rng.normal(size=6) * 0.01)))
        problem.start.insert(V(k), velocities[k] + rng.normal(size=6) * 0.05)
    for n, point in enumerate(points):
        problem.start.insert(L(n), point + rng.normal(size=3) * 0.05)
    return problem


def anchor(problem: Problem) -> Factors:
    """Priors on the first state, where all agree."""
    model = gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)
    return [
        gtsam.PriorFactorPose3(X(0), gtsam.Pose3(problem.truth[0]), model),
        gtsam.PriorFactorVector(V(0), problem.velocities[0], model),
    ]


def native_factors(problem: Problem) -> Factors:
    """GTSAM's own factors with a state at each measurement."""
    data = [gtsam.StateData(X(k), V(k), t) for k, t in enumerate(problem.times)]
    motion = [gtsam.WnoaMotionFactorPose3(i, j, QC) for i, j in pairwise(data)]
    return [*anchor(problem), *motion, *(native_stereo(problem, k) for k in range(len(data)))]


def native_stereo(problem: Problem, k: int) -> gtsam.GenericStereoFactor3D:
    u, v, disparity = problem.measured[k]
    point = gtsam.StereoPoint2(u, u - disparity, v)
    keys = X(k), L(problem.landmark[k])
    return gtsam.GenericStereoFactor3D(point, NATIVE_NOISE, *keys, NATIVE_CAMERA, False, False)


def our_factors(problem: Problem, paper: bool = False) -> Factors:
    """Ours with a state at each measurement; on request with the paper's Jacobians."""
    n = len(problem.times)
    motion = [
        WnoaPriorFactor(X(k), V(k), X(k + 1), V(k + 1), dt, QC, paper)
        for k, dt in enumerate(np.diff(problem.times))
    ]
    stereo = [
        StereoReprojectionFactor(problem.measured[k], NOISE, X(k), L(problem.landmark[k]), CAMERA)
        for k in range(n)
    ]
    return [*anchor(problem), *motion, *stereo]


def tracklet_factors(problem: Problem, stride: int) -> tuple[Factors, list[int]]:
    """Ours with a state at every stride-th time, one factor for each landmark; and those states."""
    last = len(problem.times) - 1
    knots = [*range(0, last, stride), last]
    states = [(X(k), V(k), float(problem.times[k])) for k in knots]
    motion = [WnoaPriorFactor(*i[:2], *j[:2], j[2] - i[2], QC) for i, j in pairwise(states)]
    tracklets = []
    for n in range(len(problem.points)):
        rows = np.flatnonzero(problem.landmark == n)
        if len(rows) > 1:
            measured, times = problem.measured[rows], problem.times[rows]
            tracklets.append(TrackletFactor(measured, times, NOISE, states, CAMERA, QC))
    return [*anchor(problem), *motion, *tracklets], knots


def as_graph(factors: Factors) -> gtsam.NonlinearFactorGraph:
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.add(factor)
    return graph


def fastest(
    contestants: dict[str, Callable[[], object]], rounds: int, each: int
) -> dict[str, float]:
    """Seconds of one call of each contestant, in turns; the fastest round counts."""
    best = dict.fromkeys(contestants, np.inf)
    for _ in range(rounds):
        for name, call in contestants.items():
            begin = time.perf_counter()
            for _ in range(each):
                call()
            best[name] = min(best[name], (time.perf_counter() - begin) / each)
    return best


def iteration(factors: Factors, values: gtsam.Values) -> Call:
    """One step of Gauss-Newton."""
    graph = as_graph(factors)
    ordering = gtsam.Ordering.ColamdNonlinearFactorGraph(graph)

    def step() -> object:
        linear = graph.linearize(values)
        return values.retract(linear.eliminateMultifrontal(ordering, gtsam.EliminateQR).optimize())

    step()
    return step


def position_error(problem: Problem, values: gtsam.Values, knots: list[int]) -> float:
    """Root mean square of the position error at all measurement times, metres."""
    T = np.array([values.atPose3(X(k)).matrix() for k in knots])
    v = np.array([values.atVector(V(k)) for k in knots])
    i = np.clip(
        np.searchsorted(knots, np.arange(len(problem.times)), "right") - 1, 0, len(knots) - 2
    )
    stamps = problem.times[knots]
    poses = interpolate(
        T[i], v[i], T[i + 1], v[i + 1], stamps[i], stamps[i + 1], problem.times
    ).pose
    return float(np.sqrt(np.mean(np.sum((poses - problem.truth)[:, :3, 3] ** 2, axis=1))))


def without_landmarks(values: gtsam.Values, knots: list[int]) -> gtsam.Values:
    """The states at the knots only."""
    chosen = gtsam.Values()
    for k in knots:
        chosen.insert(X(k), values.atPose3(X(k)))
        chosen.insert(V(k), values.atVector(V(k)))
    return chosen


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
    ours, robust = (tracklet_of_ten(model) for model in (NOISE, ROBUST))
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
            "tracklet": lambda: ours.linearize(own),
            "robust tracklet": lambda: robust.linearize(own),
        },
        rounds=15,
        each=60,
    )
    us = {name: 1e6 * s for name, s in seconds.items()}
    table.add_row("an empty callback, four blocks one by one, us", f"{us['one by one']:.1f}", "")
    table.add_row("  four blocks at once, us", f"{us['at once']:.1f}", "")
    table.add_row("WnoaPriorFactor, us", f"{us['prior']:.1f}", "")
    table.add_row("  to native", f"{us['prior'] / us['native prior']:.2f}", "<= 3")
    table.add_row("StereoReprojectionFactor, us", f"{us['stereo']:.1f}", "<= 15")
    table.add_row("InterpolatedStereoFactor, us", f"{us['interpolated']:.1f}", "")
    table.add_row("TrackletFactor of 10 measurements, us", f"{us['tracklet']:.1f}", "")
    for name in ("native 10", "native 10, fixed noise"):
        table.add_row(f"  {name} factors to it", f"{us[name] / us['tracklet']:.2f}", ">= 2")
    table.add_row("  with Huber's loss, us", f"{us['robust tracklet']:.1f}", "")


def empty_factors(keys: list[int]) -> Factors:
    """What a prior in Python costs without its arithmetic, by how it returns its derivatives."""
    zeros, blocks = np.zeros((12, 6)), JacobianBlocks(12, (6, 6, 6, 6))

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


def tracklet_of_ten(model: gtsam.noiseModel.Base) -> TrackletFactor:
    measured, times, states = measurements_of_ten()
    return TrackletFactor(measured, times, model, states, CAMERA, QC)


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


def gauss_newton(table: Table) -> None:
    """One iteration of the standard problem, and the same accuracy with fewer states."""
    problem = standard_problem(500)
    stride = 10
    tracklets, knots = tracklet_factors(problem, stride)
    few = without_landmarks(problem.start, knots)
    native, ours = native_factors(problem), our_factors(problem)
    seconds = fastest(
        {
            "native": iteration(native, problem.start),
            "ours": iteration(ours, problem.start),
            "tracklets": iteration(tracklets, few),
        },
        rounds=7,
        each=1,
    )
    step = pysteam_step(problem)
    if step:
        beside = fastest({"pysteam": step, "ours": iteration(ours, problem.start)}, 2, 1)
        ratio = beside["pysteam"] / beside["ours"]
        table.add_row("  pysteam to ours", f"{ratio:.0f}", ">= 50")
    every = list(range(500))
    solved = {
        "native": position_error(problem, optimize(as_graph(native), problem.start), every),
        "ours": position_error(problem, optimize(as_graph(ours), problem.start), every),
        "tracklets": position_error(problem, optimize(as_graph(tracklets), few), knots),
    }
    table.add_row("Gauss-Newton step, native, QR, ms", f"{1e3 * seconds['native']:.1f}", "")
    table.add_row("  ours to native", f"{seconds['ours'] / seconds['native']:.2f}", "<= 1.3")
    ratio = seconds["native"] / seconds["tracklets"]
    table.add_row(f"  native to tracklets, 1 state in {stride}", f"{ratio:.2f}", ">= 3")
    for name, error in solved.items():
        table.add_row(f"  position error of {name}, mm", f"{1e3 * error:.2f}", "the same")


def first_order(table: Table) -> None:
    """What the paper's first-order E_21 and E_23 do to convergence, the slower the states."""
    for interval in (0.005, 0.05, 0.15):
        problem = standard_problem(100, interval, active=1)
        for name, paper in (("exact", False), ("first-order", True)):
            count = steps(our_factors(problem, paper), problem)
            table.add_row(f"steps to 1e-9, {name} E_21 and E_23, {interval} s", str(count), "")


def pysteam_step(problem: Problem) -> Call | None:
    """One Gauss-Newton step of asrl-pysteam on the same problem, if it is installed.

    Its convention is that of the paper: world to camera, translation first.
    """
    try:
        from pylgmath import Transformation
        from pysteam.evaluable.se3 import SE3StateVar
        from pysteam.evaluable.stereo import (
            CameraIntrinsics,
            ComposeLandmarkEvaluator,
            HomoPointStateVar,
            StereoErrorEvaluator,
        )
        from pysteam.evaluable.vspace import VSpaceStateVar
        from pysteam.problem import (
            L2LossFunc,
            OptimizationProblem,
            StaticNoiseModel,
            WeightedLeastSquareCostTerm,
        )
        from pysteam.solver import GaussNewtonSolver
        from pysteam.trajectory import Time
        from pysteam.trajectory.const_vel import Interface
    except ImportError:
        return None
    swap = np.roll(np.eye(6), 3, axis=0)
    start, trajectory, opt = problem.start, Interface(qcd=swap @ QC), OptimizationProblem()
    points = [
        HomoPointStateVar(np.r_[start.atPoint3(L(n)), 1.0][:, None])
        for n in range(len(problem.points))
    ]
    u, v, disparity = problem.measured.T
    measured = np.stack([u, v, u - disparity, v], axis=-1)[..., None]
    sigmas = SIGMAS[[0, 1, 2, 1]] * [1, np.sqrt(2), 1, np.sqrt(2)]
    noise, loss = StaticNoiseModel(np.diag(sigmas**2)), L2LossFunc()
    intrinsics = CameraIntrinsics(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, CAMERA.baseline)
    poses = []
    for k, t in enumerate(problem.times):
        T_camera_world = Transformation(T_ba=se3_inverse(start.atPose3(X(k)).matrix()))
        poses.append(SE3StateVar(T_camera_world))
        velocity = VSpaceStateVar(-swap @ start.atVector(V(k))[:, None])
        trajectory.add_knot(time=Time(t), T_k0=poses[k], w_0k_ink=velocity)
        opt.add_state_var(poses[k], velocity)
    opt.add_state_var(*points)
    first = Transformation(T_ba=se3_inverse(problem.truth[0]))
    trajectory.add_pose_prior(Time(problem.times[0]), first, 1e-6 * np.eye(6))
    opt.add_cost_term(*trajectory.get_prior_cost_terms())
    for k, n in enumerate(problem.landmark):
        seen = ComposeLandmarkEvaluator(poses[k], points[n])
        error = StereoErrorEvaluator(measured[k], intrinsics, seen)
        opt.add_cost_term(WeightedLeastSquareCostTerm(error, noise, loss))
    solver = GaussNewtonSolver(opt)
    return solver.linearize_solve_and_update


def steps(factors: Factors, problem: Problem) -> int:
    """Gauss-Newton steps until the error changes by less than 1e-9 of itself."""
    graph, values = as_graph(factors), problem.start
    ordering = gtsam.Ordering.ColamdNonlinearFactorGraph(graph)
    error = graph.error(values)
    for count in range(1, 100):
        linear = graph.linearize(values)
        values = values.retract(
            linear.eliminateMultifrontal(ordering, gtsam.EliminateQR).optimize()
        )
        before, error = error, graph.error(values)
        if abs(before - error) <= 1e-9 * before:
            return count
    return 100


def cost_per_state(table: Table) -> None:
    """Milliseconds of one Gauss-Newton step for each state."""
    calls = {}
    for states in (100, 500, 2000, 5000):
        problem = standard_problem(states)
        calls[states] = iteration(our_factors(problem), problem.start)
    seconds = fastest({str(n): call for n, call in calls.items()}, rounds=2, each=1)
    for states in calls:
        table.add_row(
            f"ms per state, {states} states",
            f"{1e3 * seconds[str(states)] / states:.3f}",
            "constant",
        )


def plot_growth(path: Path) -> None:
    """Milliseconds of a Gauss-Newton step for each state, over the number of states."""
    from matplotlib import pyplot

    counts = [100, 200, 500, 1000, 2000, 5000]
    figure, axes = pyplot.subplots()
    for name, factors in (("native", native_factors), ("ours", our_factors)):
        problems = {str(n): standard_problem(n) for n in counts}
        calls = {n: iteration(factors(p), p.start) for n, p in problems.items()}
        seconds = fastest(calls, rounds=3, each=1)
        axes.semilogx(counts, [1e3 * seconds[str(n)] / n for n in counts], "o-", label=name)
    axes.set(xlabel="states", ylabel="ms per state and Gauss-Newton step", ylim=(0, None))
    axes.legend()
    figure.savefig(path)


def main(plot: Path | None = None) -> None:
    """Print all ratios; with a path also save the plot of the cost per state."""
    table = Table("measured", "here", "wanted")
    for section in (single_factors, growth, gauss_newton, first_order, cost_per_state):
        section(table)
        table.add_section()
    Console().print(table)
    if plot:
        plot_growth(plot)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
