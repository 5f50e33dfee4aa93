"""Nonlinear optimization, driven from Python: Gauss-Newton, Levenberg-Marquardt and Dogleg.

When GTSAM's own optimisers call back into Python they copy all values for each factor, at a cost
that grows with the number of variables. Here Python owns the values and nothing is copied. The
linear system is solved by QR, because GTSAM 4.3's Cholesky refuses well-posed chains of states that
are close in time.
"""

from __future__ import annotations

import math
from time import perf_counter
from typing import NamedTuple

import gtsam
import numpy as np

from factors.kernels.se3 import Array

Parameters = gtsam.GaussNewtonParams | gtsam.LevenbergMarquardtParams | gtsam.DoglegParams

_MIN_FIDELITY = 1e-3  # GTSAM's, which it does not tell in Python
_DIAGONAL = 1e-6, 1e32
_SMALLEST_RADIUS = 1e-5


class Iteration(NamedTuple):
    """One step of an optimization.

    Attributes
    ----------
    error
        Of the graph after the step.
    step
        Norm of the step; zero if none was found that lowers the error.
    damping
        Lambda of Levenberg-Marquardt, radius of Dogleg, 0 of Gauss-Newton, for the next step.
    seconds
        Time that it took.
    """

    error: float
    step: float
    damping: float
    seconds: float


class Step(NamedTuple):
    """Values after a step, their error and the norm of the step."""

    values: gtsam.Values
    error: float
    norm: float


def optimize(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    parameters: Parameters | None = None,
    ordering: gtsam.Ordering | None = None,
    report: list[Iteration] | None = None,
) -> gtsam.Values:
    """Find the values at the least-squares optimum of a graph.

    Parameters
    ----------
    graph
        Any GTSAM factors, native or written in Python.
    values
        Initial values; not changed.
    parameters
        GTSAM's, of the method to use: GaussNewtonParams, LevenbergMarquardtParams, DoglegParams.
        Their linear solver, ordering and verbosity are not used. By default those of
        `gauss_newton_parameters`.
    ordering
        Elimination order of all variables; by COLAMD if none is given.
    report
        A list to which each iteration is appended.

    Raises
    ------
    ValueError
        If the error is infinite or not a number, at the start or after a step of Gauss-Newton.
    RuntimeError
        From GTSAM, naming the variable, if the measurements do not determine it.
    """
    parameters = gauss_newton_parameters() if parameters is None else parameters
    if ordering is None:
        ordering = gtsam.Ordering.ColamdNonlinearFactorGraph(graph)
    method = _method(graph, ordering, parameters)
    error = _finite(graph.error(values))
    for _ in range(parameters.getMaxIterations()):
        started = perf_counter()
        found = method.step(values, error, graph.linearize(values))
        seconds = perf_counter() - started
        if report is not None:
            report.append(Iteration(found.error, found.norm, method.damping, seconds))
        values, before, error = found.values, error, found.error
        if _converged(parameters, before, error):
            break
    return values


def gauss_newton_parameters(
    max_iterations: int = 20, tolerance: float = 1e-9
) -> gtsam.GaussNewtonParams:
    """Make parameters of Gauss-Newton.

    At most `max_iterations` steps, until one changes the error by at most tolerance * max(1, error
    before the step).
    """
    parameters = gtsam.GaussNewtonParams()
    parameters.setMaxIterations(max_iterations)
    parameters.setRelativeErrorTol(tolerance)
    parameters.setAbsoluteErrorTol(tolerance)
    return parameters


def _finite(error: float) -> float:
    """Return the error itself, or raise ValueError if it is not finite."""
    if not math.isfinite(error):
        raise ValueError("values have no finite error: too far from the optimum to start, or lost")
    return error


def _converged(parameters: Parameters, before: float, error: float) -> bool:
    """Tell whether a step changed the error too little to go on."""
    change = abs(before - error)
    relative = change <= parameters.getRelativeErrorTol() * before
    absolute = change <= parameters.getAbsoluteErrorTol()
    return relative or absolute or error <= parameters.getErrorTol()


def _method(
    graph: gtsam.NonlinearFactorGraph, ordering: gtsam.Ordering, parameters: Parameters
) -> _GaussNewton | _LevenbergMarquardt | _Dogleg:
    if isinstance(parameters, gtsam.LevenbergMarquardtParams):
        return _LevenbergMarquardt(graph, ordering, parameters)
    if isinstance(parameters, gtsam.DoglegParams):
        return _Dogleg(graph, ordering, parameters)
    if isinstance(parameters, gtsam.GaussNewtonParams):
        return _GaussNewton(graph, ordering)
    kinds = "GaussNewtonParams, LevenbergMarquardtParams or DoglegParams"
    raise ValueError(f"parameters must be GTSAM's {kinds}, not {type(parameters).__name__}")


class _GaussNewton:
    """Full steps to the optimum of the linearised graph."""

    damping = 0.0

    def __init__(self, graph: gtsam.NonlinearFactorGraph, ordering: gtsam.Ordering) -> None:
        self._graph, self._ordering = graph, ordering

    def step(self, values: gtsam.Values, _: float, linear: gtsam.GaussianFactorGraph) -> Step:
        delta = linear.eliminateMultifrontal(self._ordering, gtsam.EliminateQR).optimize()
        moved = values.retract(delta)
        return Step(moved, _finite(self._graph.error(moved)), delta.norm())


class _LevenbergMarquardt:
    """Steps of a graph that is damped until they lower the error, as GTSAM takes them."""

    def __init__(
        self,
        graph: gtsam.NonlinearFactorGraph,
        ordering: gtsam.Ordering,
        parameters: gtsam.LevenbergMarquardtParams,
    ) -> None:
        self._graph, self._ordering, self._parameters = graph, ordering, parameters
        self.damping = parameters.getlambdaInitial()
        self._factor = parameters.getlambdaFactor()
        self._still = gtsam.Values()
        self._zeros: list[tuple[int, Array]] = []

    def step(self, values: gtsam.Values, error: float, linear: gtsam.GaussianFactorGraph) -> Step:
        zeros = values.zeroVectors()
        if not self._zeros:
            self._zeros = [(key, zeros.at(key)) for key in sorted(linear.keyVector())]
            for key, zero in self._zeros:
                self._still.insert(key, vector=zero)
        scales, at_zero = self._scales(linear), linear.error(zeros)
        while True:
            delta = self._solved(linear, scales)
            if delta is not None:
                model, moved = at_zero - linear.error(delta), values.retract(delta)
                moved_error = self._graph.error(moved)
                gain = error - moved_error
                if model > 1e-15 * at_zero and gain > _MIN_FIDELITY * model:
                    self._decrease(gain / model)
                    return Step(moved, moved_error, delta.norm())
                if abs(gain) < self._parameters.getRelativeErrorTol() * error:
                    return Step(values, error, 0.0)
            if self.damping >= self._parameters.getlambdaUpperBound():
                return Step(values, error, 0.0)
            self._increase()

    def _solved(
        self, linear: gtsam.GaussianFactorGraph, scales: list[Array] | None
    ) -> gtsam.VectorValues | None:
        """Solve the damped graph; None if even that is not determined.

        GTSAM makes the damping of priors in a tenth of the time that Python needs for it.
        """
        priors, sigma = gtsam.NonlinearFactorGraph(), math.inf
        if self.damping > 0:
            sigma = 1 / math.sqrt(self.damping)
        isotropic, diagonal = gtsam.noiseModel.Isotropic.Sigma, gtsam.noiseModel.Diagonal.Sigmas
        alike = {len(zero): isotropic(len(zero), sigma) for _, zero in self._zeros}
        for n, (key, zero) in enumerate(self._zeros):
            model = alike[len(zero)] if scales is None else diagonal(sigma / scales[n])
            priors.addPriorVector(key, zero, model)
        damped = priors.linearize(self._still)
        damped.push_back(linear)
        try:
            return damped.eliminateMultifrontal(self._ordering, gtsam.EliminateQR).optimize()
        except RuntimeError:
            return None

    def _scales(self, linear: gtsam.GaussianFactorGraph) -> list[Array] | None:
        """Return the scales of the damping as the Hessian's diagonal; None if they are ones."""
        if not self._parameters.getDiagonalDamping():
            return None
        _, columns, entries = linear.sparseJacobian_()
        squares = np.bincount(columns.astype(int) - 1, entries**2)
        diagonal = np.sqrt(np.clip(squares, *_DIAGONAL))
        ends = np.cumsum([len(zero) for _, zero in self._zeros])
        return np.split(diagonal[: ends[-1]], ends[:-1])

    def _decrease(self, fidelity: float) -> None:
        if self._parameters.getUseFixedLambdaFactor():
            self.damping /= self._factor
        else:
            self.damping *= max(1 / 3, 1 - (2 * fidelity - 1) ** 3)
            self._factor = 2 * self._parameters.getlambdaFactor()
        self.damping = max(self._parameters.getlambdaLowerBound(), self.damping)

    def _increase(self) -> None:
        self.damping *= self._factor
        if not self._parameters.getUseFixedLambdaFactor():
            self._factor *= 2


class _Dogleg:
    """Steps within a radius, from steepest descent to Gauss-Newton, as GTSAM takes them."""

    def __init__(
        self,
        graph: gtsam.NonlinearFactorGraph,
        ordering: gtsam.Ordering,
        parameters: gtsam.DoglegParams,
    ) -> None:
        self._graph, self._ordering = graph, ordering
        self.damping = parameters.getDeltaInitial()

    def step(self, values: gtsam.Values, error: float, linear: gtsam.GaussianFactorGraph) -> Step:
        tree = linear.eliminateMultifrontal(self._ordering, gtsam.EliminateQR)
        newton, steepest = tree.optimize(), tree.optimizeGradientSearch()
        at_zero = linear.error(values.zeroVectors())
        while self.damping > _SMALLEST_RADIUS:
            delta = _dogleg(self.damping, steepest, newton)
            moved = values.retract(delta)
            moved_error = self._graph.error(moved)
            model, gain = at_zero - linear.error(delta), error - moved_error
            if gain >= 0:
                self._adapt(gain, model, delta.norm())
                return Step(moved, moved_error, delta.norm())
            self.damping /= 2
        return Step(values, error, 0.0)

    def _adapt(self, gain: float, model: float, norm: float) -> None:
        """Widen the radius if the linearised graph predicted the gain well, else narrow it."""
        if gain >= 0.75 * model:
            self.damping = max(self.damping, 3 * norm)
        elif gain < 0.25 * model:
            self.damping /= 2


def _dogleg(
    radius: float, steepest: gtsam.VectorValues, newton: gtsam.VectorValues
) -> gtsam.VectorValues:
    """Return where the path by the steepest descent to Newton's step leaves the radius."""
    if newton.norm() <= radius:
        return newton
    if steepest.norm() >= radius:
        return steepest.scale(radius / steepest.norm())
    onward = newton.subtract(steepest)
    a, b, c = onward.squaredNorm(), steepest.dot(onward), steepest.squaredNorm() - radius**2
    return steepest.add(onward.scale((math.sqrt(b * b - a * c) - b) / a))
