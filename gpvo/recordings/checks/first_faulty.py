"""Find an event that no sensor sends: off its pixels, or earlier than the one before."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.recordings.calibration.rig import Camera


def first_faulty(
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: NDArray[Any],
    camera: Camera,
    before: float,
) -> int | None:
    """Return the first of the events (N,) that is off the sensor or earlier than the one before.

    `before` is the time of the one before them, in the unit of t; a time that is no number is
    faulty. None if all are as they should be.
    """
    found = _first_faulty(x, y, t, *camera.resolution, before)
    return None if found < 0 else int(found)


@kernel
def _first_faulty(
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: NDArray[Any],
    width: int,
    height: int,
    before: float,
) -> int:
    for i in range(len(t)):
        if x[i] >= width or y[i] >= height or not t[i] >= before:
            return i
        before = t[i]
    return -1
