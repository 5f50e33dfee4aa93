"""Leave out new measurements that are not where those before them predict them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from factors import StructurelessStereoFactor
from gpvo.estimator.diagnostics import Diagnostic, left_out
from gpvo.estimator.graph_update import NumberedStates
from gpvo.estimator.isam2 import prior_covariance
from gpvo.tracking.measurements import Measurements

Array = NDArray[np.float64]
BEYOND_GATE = "beyond the gate"


def within_gate(
    known: StructurelessStereoFactor | None,
    window: NumberedStates,
    covariance: Array,
    new: Measurements,
    share: float,
) -> tuple[Measurements, list[Diagnostic]]:
    """Return the new measurements within the gate, and a diagnostic for each other one.

    The factor of the known measurements predicts them, given the states of the window and their
    covariance (12 K, 12 K) before the new ones are used. Their squared Mahalanobis distance from
    that is at most the quantile of `share` of the chi-squared distribution; measurements of
    landmarks that are not known are within.
    """
    if known is None:
        return new, []
    t = np.clip(new.t, window.states.t[0], window.states.t[-1])
    measured = new.stereo, t, new.landmark
    try:
        distance = known.squared_distances(window.values(), *measured, covariance, new.deviations)
    except np.linalg.LinAlgError:  # what is known predicts nothing
        return new, []
    inside = ~(distance > 2 * gammaincinv(1.5, share))
    return new[inside], left_out(new[~inside], BEYOND_GATE)


def predicted_covariance(known: Array, t: Array, qc: Sequence[float]) -> Array:
    """(12 K, 12 K) of all key states, given that of the first ones, as the prior predicts the rest.

    The times t are those from the last known state on.
    """
    old, new = slice(0, len(known)), slice(len(known), None)
    covariance = np.zeros(2 * (len(known) + 12 * len(t) - 12,))
    ahead = prior_covariance(known[-12:, -12:], t, qc)
    gain = np.linalg.solve(known[-12:, -12:], known[-12:]).T
    covariance[old, old], covariance[new, new] = known, ahead[12:, 12:]
    covariance[old, new] = gain @ ahead[:12, 12:]
    covariance[new, old] = covariance[old, new].T
    return covariance
