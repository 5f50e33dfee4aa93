"""Do the events fill the sensor that the calibration describes?"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gpvo.errors import InputError
from gpvo.recordings.base import Recording

ENOUGH_EVENTS = 30_000
"""By then every sensor has had events near its borders, be it of noise."""
SMALLEST_SHARE = 0.75
"""Of the calibrated width and height; sensors of one family differ by more."""


def check_sensor_size(recording: Recording, calibration: Path | str | None) -> None:
    """Compare the first events' pixels with the calibrated resolution.

    Raises
    ------
    InputError
        If both axes are used up to a fraction only: the calibration is that of a larger sensor.
    """
    used, count = np.zeros(2), 0
    for batch in recording.event_batches():
        for events in (batch.left, batch.right):
            if len(events):
                used = np.maximum(used, [events.x.max() + 1, events.y.max() + 1])
                count += len(events)
        if count >= ENOUGH_EVENTS:
            break
    size = np.array(recording.rig.resolution)
    if count >= ENOUGH_EVENTS and (used < SMALLEST_SHARE * size).all():
        raise InputError(
            f"{calibration or recording.path}: calibrates {size[0]} x {size[1]} pixels, but the"
            f" first {count} events of {recording.path} reach no farther than {used[0]:.0f} x"
            f" {used[1]:.0f}; give the calibration of this camera's resolution"
        )
