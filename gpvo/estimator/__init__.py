"""Measurements become states: the factor graph and its solvers, section III-C.1 of the paper."""

from gpvo.estimator.blas_threads import one_blas_thread
from gpvo.estimator.diagnostics import Repair
from gpvo.estimator.estimator import Estimator, make_estimator
from gpvo.estimator.smoother import FixedLagSmoother

__all__ = [
    "Estimator",
    "FixedLagSmoother",
    "Repair",
    "make_estimator",
    "one_blas_thread",
]
