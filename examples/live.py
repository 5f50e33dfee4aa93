"""The pose while events come: `LiveOdometry`, fed with numpy arrays as a camera's driver has them.

A simulated camera stands in for yours: every 5 ms it gives each camera's new events as x, y, t in
microseconds, and polarity.
"""

from __future__ import annotations

import numpy as np

from gpvo import LiveOdometry
from gpvo.live import RawEvents
from gpvo.recordings import Events
from gpvo.simulation import SimulationConfig, simulate

recording = simulate(SimulationConfig(seed=1, duration=1.0, resolution=(240, 180)))


def new_events(events: Events, start: float) -> RawEvents:
    """Return what a driver gives for the 5 ms from `start` on."""
    new = events.between(start, start + 0.005)
    return new.x, new.y, np.rint(1e6 * new.t).astype(np.int64), new.polarity


with LiveOdometry(recording.rig) as live:
    for start in np.arange(0, recording.duration, 0.005):
        estimated = live.push(new_events(recording.left, start), new_events(recording.right, start))
        now = live.latest()
        if estimated and now is not None:
            x, y, z = now.T_world_cam[:3, 3]
            sigma = 1e3 * np.sqrt(np.diag(now.covariance)[3:6].max())
            print(f"{now.t:.3f} s: {x:+.3f} {y:+.3f} {z:+.3f} m, within {sigma:.1f} mm")
