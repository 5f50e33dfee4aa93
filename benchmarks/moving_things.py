"""Things that move by themselves in front of both cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.fault_cases import Rng, merged
from gpvo.recordings import Events
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate

BEGIN, SPEED = 0.12, 0.17
"""Where the left edge is at first, and by how much it moves per second, widths of the image."""
ROWS = (0.23, 0.85)
"""Rows that it covers, heights of the image."""
NEAR = 0.03
"""Disparity, widths of the image."""


def passes_by(
    recording: SimulatedRecording, t: float, rng: Rng, width: float
) -> SimulatedRecording:
    """Let a window, `width` times as wide as the image, pass by that shows another room.

    There a camera moves fast: what is in the window agrees with itself, and not with the scene.
    """
    columns, rows = recording.rig.resolution
    config = SimulationConfig(
        seed=int(rng.integers(2**31)),
        motion="fast",
        duration=recording.duration,
        resolution=(columns, rows),
        focal_length=recording.rig.focal_length,
    )
    other = simulate(config)

    def shown(events: Events, shift: float) -> NDArray[np.bool_]:
        left = columns * (BEGIN + SPEED * events.t - shift)
        inside = (events.x > left) & (events.x < left + columns * width)
        return inside & (events.y > rows * ROWS[0]) & (events.y < rows * ROWS[1])

    def with_window(events: Events, more: Events, shift: float) -> Events:
        more = more.between(0.0, recording.duration)
        return merged(events[~shown(events, shift)], more[shown(more, shift)])

    return replace(
        recording,
        left=with_window(recording.left, other.left, 0.0),
        right=with_window(recording.right, other.right, NEAR),
    )
