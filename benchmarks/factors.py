"""Speed of the factors, as ratios to GTSAM's native ones from one interleaved run.

Run as ``python -m benchmarks.factors``, with a file name for a plot of the cost per state. Each
time is the fastest of many rounds in which all contestants take turns.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from itertools import cycle
from pathlib import Path

import gtsam
from rich.console import Console
from rich.table import Table

from benchmarks.factors_callbacks import growth, single_factors
from benchmarks.factors_problem import (
    QC,
    Factors,
    Problem,
    as_graph,
    native_factors,
    native_interpolated_factors,
    our_factors,
    position_error,
    standard_problem,
    structureless_factors,
    tracklet_factors,
    with_landmarks,
    without_landmarks,
)
from benchmarks.factors_pysteam import pysteam_step
from benchmarks.factors_table import all_factors, whole_optimisations
from benchmarks.turns import fastest
from factors import optimize
from gpvo.estimator.blas_threads import one_blas_thread

Call = Callable[[], object]


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


def key_states_window(table: Table) -> None:
    """One iteration of a smoother's window: 7 states, 601 measurements of 120 landmarks."""
    stride = 100
    problem = standard_problem(6 * stride + 1, interval=5e-4, active=120)
    tracklets, knots = tracklet_factors(problem, stride)
    few = without_landmarks(problem.start, knots)
    one = structureless_factors(problem, stride)
    native = native_interpolated_factors(problem, stride)
    seconds = fastest(
        {
            "one": iteration(one, few),
            "robust": iteration(structureless_factors(problem, stride, robust=True), few),
            "own states": iteration(structureless_factors(problem, stride, qc=QC), few),
            "tracklets": iteration(tracklets, few),
            "native": iteration(native, with_landmarks(problem, knots)),
        },
        rounds=7,
        each=10,
    )
    own = seconds["one"]
    table.add_row("step of 7 states, one StructurelessStereoFactor, ms", f"{1e3 * own:.2f}", "")
    table.add_row(
        "  one factor for each landmark to it", f"{seconds['tracklets'] / own:.2f}", ">= 4"
    )
    table.add_row("  native, with landmarks, to it", f"{seconds['native'] / own:.2f}", ">= 4")
    table.add_row("  with Huber's loss to it", f"{seconds['robust'] / own:.2f}", "<= 1.5")
    ratio = seconds["own states"] / own
    table.add_row("  with Q_c, each time a state of its own, to it", f"{ratio:.2f}", "")


def iteration(factors: Factors, values: gtsam.Values) -> Call:
    """One step of Gauss-Newton, of the start and of its result in turns.

    A factor may keep what it found for the values that it saw last.
    """
    graph = as_graph(factors)
    ordering = gtsam.Ordering.ColamdNonlinearFactorGraph(graph)

    def step(values: gtsam.Values) -> gtsam.Values:
        linear = graph.linearize(values)
        return values.retract(linear.eliminateMultifrontal(ordering, gtsam.EliminateQR).optimize())

    turns = cycle((values, step(values)))
    return lambda: step(next(turns))


def first_order(table: Table) -> None:
    """What the paper's first-order E_21 and E_23 do to convergence, the slower the states."""
    for interval in (0.005, 0.05, 0.15):
        problem = standard_problem(100, interval, active=1)
        for name, paper in (("exact", False), ("first-order", True)):
            count = steps(our_factors(problem, paper), problem)
            table.add_row(f"steps to 1e-9, {name} E_21 and E_23, {interval} s", str(count), "")


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
    sections = (
        single_factors,
        all_factors,
        whole_optimisations,
        growth,
        gauss_newton,
        key_states_window,
        first_order,
        cost_per_state,
    )
    for section in sections:
        with one_blas_thread():  # as in the estimator
            section(table)
        table.add_section()
    Console().print(table)
    if plot:
        plot_growth(plot)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plot", nargs="?", type=Path, help="file for a plot of the cost per state")
    main(parser.parse_args().plot)
