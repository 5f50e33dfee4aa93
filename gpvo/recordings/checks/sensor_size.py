"""Check that the calibration is of the sensor that a file states, and that the events fill it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gpvo.errors import InputError
from gpvo.recordings.base import Recording
from gpvo.recordings.calibration.unknown import LARGEST

ENOUGH_EVENTS = 30_000
"""Number after which every sensor has had events near its borders, at least from noise."""
SMALLEST_SHARE = 0.75
"""Share of the calibrated width and height; sensors of one family differ by more."""


def check_resolution(
    stated: tuple[int, ...] | None, calibrated: tuple[int, int], where: str
) -> None:
    """Raise InputError if a file states a resolution other than the calibrated one."""
    if stated is not None and stated != calibrated != LARGEST:
        raise InputError(
            f"{where} is of a {stated[0]} x {stated[1]} sensor, the calibration of one of"
            f" {calibrated[0]} x {calibrated[1]}; give this camera's calibration"
        )


def check_sensor_size(recording: Recording, calibration: Path | str | None) -> None:
    """Compare the first events' pixels with the calibrated resolution.

    Raises
    ------
    InputError
        If the events use only a part of both axes: the calibration is of a larger sensor.
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
