"""What an estimator had to leave out or rebuild in order to go on."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpvo.tracking.measurements import Measurements

Array = NDArray[np.float64]

BEFORE_WINDOW = "time lies before the window"


@dataclass(frozen=True)
class Diagnostic:
    """One thing that was left out or rebuilt.

    Attributes
    ----------
    key
        The variable: l and the landmark's number, or GTSAM's name of a state's.
    t
        Its time: of the measurement, or of the state; seconds.
    measurement
        (u_left, v, disparity) in rectified pixels; None for a state.
    reason
        What was wrong, and what was done.
    """

    key: str
    t: float
    measurement: tuple[float, float, float] | None
    reason: str

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name, for JSON."""
        return asdict(self)


def left_out(measurements: Measurements, reason: str) -> list[Diagnostic]:
    """Return a diagnostic for each measurement that is left out for a reason."""
    return diagnostics_of(measurements, f"{reason}: measurement left out")


def diagnostics_of(measurements: Measurements, reason: str) -> list[Diagnostic]:
    """Return a diagnostic for each measurement that is left out."""
    return [
        Diagnostic(f"l{landmark}", t, (stereo[0], stereo[1], stereo[2]), reason)
        for landmark, t, stereo in zip(
            measurements.landmark.tolist(),
            measurements.t.tolist(),
            measurements.stereo.tolist(),
            strict=True,
        )
    ]


def checked_measurements(measurements: Measurements) -> Measurements:
    """Return the measurements if their columns have the right types and lengths.

    Raises
    ------
    ValueError
        If landmarks are no integers, or columns differ in length.
    """
    if np.asarray(measurements.landmark).dtype.kind not in "iu":
        kind = np.asarray(measurements.landmark).dtype
        raise ValueError(f"measurements.landmark must be integers, not {kind}")
    count = len(measurements.t)
    one, three = (count,), (count, 3)
    shapes = {"landmark": one, "frame": one, "t": one, "stereo": three, "deviations": three}
    for name, shape in shapes.items():
        column = getattr(measurements, name)
        if not isinstance(column, np.ndarray):
            raise ValueError(f"measurements.{name} must be an array, not {type(column).__name__}")
        found = column.shape
        if found != shape:
            raise ValueError(f"measurements.{name} must have the shape {shape}, not {found}")
    return measurements


def split_usable(
    measurements: Measurements, t_window: Array, latest: float
) -> tuple[Measurements, list[Diagnostic]]:
    """Return the measurements that can be used, and a diagnostic for each other one.

    All numbers must be finite, disparity and deviations positive, and times not before the first
    one (K,) in the window, if any, nor after the latest, seconds.

    Raises
    ------
    ValueError
        If a column of the measurements has another type or length.
    """
    stereo, t = checked_measurements(measurements).stereo, measurements.t
    deviations = measurements.deviations
    numbers = np.column_stack([stereo, t, deviations])
    earliest = t_window[0] if len(t_window) else -np.inf
    reasons = {
        "not a finite number": ~np.isfinite(numbers).all(axis=1),
        "disparity is not positive": ~(stereo[:, 2] > 0),
        "deviations are not positive": ~(deviations > 0).all(axis=1),
        "time lies beyond the cluster's end": t > latest,
        BEFORE_WINDOW: t < earliest,
    }
    usable = np.ones(len(t), bool)
    diagnostics: list[Diagnostic] = []
    for reason, wrong in reasons.items():
        if wrong.any():
            diagnostics += left_out(measurements[wrong & usable], reason)
            usable &= ~wrong
    return measurements[usable], diagnostics


def named_landmark(error: Exception, measurements: Measurements) -> Measurements:
    """Return the measurements of the landmark that GTSAM's error names; all if it names none.

    GTSAM writes the key as "l42" into the message of an indeterminate system.
    """
    for number in re.findall(r"\bl(\d+)\b", str(error)):
        named = measurements[measurements.landmark == int(number)]
        if len(named):
            return named
    return measurements
