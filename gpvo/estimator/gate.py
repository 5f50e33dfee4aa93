"""Leaving out new measurements that are not where those before them predict them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpvo.estimator.diagnostics import Repair, repairs_of
from gpvo.estimator.gaussian import IndeterminateError
from gpvo.estimator.graph_builder import state_times
from gpvo.estimator.lag_window import BEYOND_GATE, LagWindow, Sensor
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
INTERVAL = 0.02
"""Seconds between the states that predict, at least."""


def within_gate(
    sensor: Sensor, states: States, covariance: Array, known: Measurements, new: Measurements
) -> tuple[Measurements, list[Repair]]:
    """The new measurements within the configured gate, and a repair for each other one.

    They are predicted from states, the first of which has this covariance (12, 12), and from the
    known measurements alone, that is before they pull at the estimate. Measurements of landmarks
    that are not known are within, and all are if the known ones do not determine the states.
    """
    if sensor.config.gate == 0 or len(known) == 0 or len(new) == 0:
        return new, []
    t = state_times(np.append(states.t, new.t.max()), INTERVAL, states.t[0])
    window = LagWindow.of_state(sensor, states[:1], covariance)
    window = replace(window, states=states.at(np.append(states.t[0], t)))
    try:
        with np.errstate(all="ignore"):
            inside = window.measured(known)[0].solved()[0].inside_gate(new)
    except IndeterminateError:
        return new, []
    return new[inside], repairs_of(new[~inside], BEYOND_GATE)
