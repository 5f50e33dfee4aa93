"""Measurements become states: the factor graph and its solvers, section III-C.1 of the paper."""

from gpvo.estimator.blas_threads import one_blas_thread
from gpvo.estimator.diagnostics import Diagnostic
from gpvo.estimator.estimator import Estimator, make_estimator
from gpvo.estimator.gathered import GatheredMeasurements
from gpvo.estimator.initialization import InitialState
from gpvo.estimator.smoother import FixedLagSmoother

__all__ = [
    "Diagnostic",
    "Estimator",
    "FixedLagSmoother",
    "GatheredMeasurements",
    "InitialState",
    "make_estimator",
    "one_blas_thread",
]
