"""What an estimator had to leave out or rebuild in order to go on."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gpvo.tracking.measurements import Measurements


@dataclass(frozen=True)
class Repair:
    """One thing that was dropped or rebuilt.

    Attributes
    ----------
    key
        The variable: l and the landmark's number, or x and the state's.
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
        """The fields by name, for JSON."""
        return asdict(self)


def repairs_of(measurements: Measurements, reason: str) -> list[Repair]:
    """A repair for each measurement that is left out."""
    return [
        Repair(f"l{landmark}", t, (stereo[0], stereo[1], stereo[2]), reason)
        for landmark, t, stereo in zip(
            measurements.landmark.tolist(),
            measurements.t.tolist(),
            measurements.stereo.tolist(),
            strict=True,
        )
    ]


def split_possible(measurements: Measurements, latest: float) -> tuple[Measurements, list[Repair]]:
    """The measurements that can be true, and a repair for each other one.

    All numbers must be finite, the disparity positive, and no time beyond `latest`, seconds.
    """
    stereo, t = measurements.stereo, measurements.t
    reasons = {
        "not a finite number": ~np.isfinite(stereo).all(axis=1) | ~np.isfinite(t),
        "disparity is not positive": ~(stereo[:, 2] > 0),
        "time lies beyond the cluster's end": t > latest,
    }
    possible = np.ones(len(t), bool)
    repairs: list[Repair] = []
    for reason, wrong in reasons.items():
        repairs += repairs_of(measurements[wrong & possible], f"{reason}: measurement left out")
        possible &= ~wrong
    return measurements[possible], repairs


def named_landmark(error: Exception, measurements: Measurements) -> Measurements:
    """The measurements of the landmark that GTSAM's error names; all if it names none of them.

    GTSAM writes the key as "l42" into the message of an indeterminate system.
    """
    for number in re.findall(r"\bl(\d+)\b", str(error)):
        named = measurements[measurements.landmark == int(number)]
        if len(named):
            return named
    return measurements
