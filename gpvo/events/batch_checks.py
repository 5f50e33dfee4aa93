"""Batches as recordings of a user's own give them, checked before kernels read them unchecked."""

from __future__ import annotations

from math import isfinite

import numpy as np

from gpvo.errors import InputError
from gpvo.recordings import Camera, Events, StereoEvents, StereoRig
from gpvo.recordings.base import SIDES
from gpvo.recordings.checks.first_faulty import first_faulty

KINDS = {"x": "uint16", "y": "uint16", "t": "float64", "polarity": "bool"}


def checked_batch(batch: StereoEvents, rig: StereoRig) -> StereoEvents:
    """Return the batch if its interval and its events are what `StereoEvents` and `Events` say.

    Raises
    ------
    InputError
        If a time is not finite, a column has another type or length, or events lie outside the
        sensor or go back in time.
    """
    if not (isfinite(batch.start) and isfinite(batch.stop) and batch.start <= batch.stop):
        raise InputError(
            f"batch: from {batch.start} to {batch.stop} s; give finite seconds, the start first"
        )
    for side, events, camera in zip(
        SIDES, (batch.left, batch.right), (rig.left, rig.right), strict=True
    ):
        _check_events(events, side, camera)
    return batch


def _check_events(events: Events, side: str, camera: Camera) -> None:
    for name, kind in KINDS.items():
        column = getattr(events, name)
        if column.dtype != kind or column.shape != (len(events.t),):
            raise InputError(
                f"{side} {name}: must be {kind}, one for each event, not {column.dtype} of the"
                f" shape {column.shape}"
            )
    wrong = first_faulty(events.x, events.y, events.t, camera, -np.inf)
    if wrong is None:
        return
    width, height = camera.resolution
    x, y, t = events.x[wrong], events.y[wrong], events.t[wrong]
    if x >= width or y >= height:
        raise InputError(
            f"{side}: event {wrong} is at pixel ({x}, {y}), outside the {width} x {height} sensor;"
            " leave such events out, or give this camera's calibration"
        )
    raise InputError(f"{side} t: {t} s at event {wrong} goes back in time; sort the events by time")
