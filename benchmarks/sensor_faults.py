"""Sensors that are not as they should be: hot, flickering and dead pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.fault_cases import Rng, merged
from gpvo.recordings import Events
from gpvo.simulation import SimulatedRecording

LAMP = np.array([[60, 40], [90, 60]])
"""First and last column and row (2, 2) of what flickers, in the left image."""


def hot_pixels(
    recording: SimulatedRecording, t: float, rng: Rng, number: int, rate: float
) -> SimulatedRecording:
    """Let some pixels of each camera fire all the time, at `rate` Hz each."""

    def with_hot(events: Events) -> Events:
        width, height = recording.rig.resolution
        x, y = rng.integers(0, width, number), rng.integers(0, height, number)
        count = rng.poisson(number * rate * recording.duration)
        which = rng.integers(0, number, count)
        times = rng.uniform(0.0, recording.duration, count)
        return with_more(events, x[which], y[which], times)

    left, right = with_hot(recording.left), with_hot(recording.right)
    return replace(recording, left=left, right=right)


def flicker(
    recording: SimulatedRecording, t: float, rng: Rng, frequency: float, disparity: int
) -> SimulatedRecording:
    """Let a patch of both images switch on and off, once a half period, for 2 ms."""

    def with_lamp(events: Events, shift: int) -> Events:
        (first_x, first_y), (last_x, last_y) = LAMP
        x, y = (a.ravel() for a in np.mgrid[first_x:last_x, first_y:last_y])
        starts = np.arange(0.0, recording.duration - 0.002, 0.5 / frequency)
        times = starts[:, None] + rng.uniform(0.0, 0.002, (len(starts), len(x)))
        columns = np.broadcast_to(x - shift, times.shape)
        rows = np.broadcast_to(y, times.shape)
        return with_more(events, columns.ravel(), rows.ravel(), times.ravel())

    left, right = with_lamp(recording.left, 0), with_lamp(recording.right, disparity)
    return replace(recording, left=left, right=right)


def half_dead(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
    """Let half the pixels of the right camera, drawn at random, see nothing."""
    width, height = recording.rig.resolution
    alive, right = rng.random((height, width)) < 0.5, recording.right
    return replace(recording, right=right[alive[right.y, right.x]])


def with_more(events: Events, x: np.ndarray, y: np.ndarray, t: np.ndarray) -> Events:
    """Add events at columns, rows and times (N,), seconds, to a stream."""
    polarity = np.arange(len(t)) % 2 == 0
    more = Events(x.astype(np.uint16), y.astype(np.uint16), t.round(6), polarity)
    return merged(events, more)
