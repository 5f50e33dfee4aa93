"""The odometry of a running camera: events are pushed as they come, the pose is there at once."""

from gpvo.live.live_odometry import LiveOdometry
from gpvo.live.raw_events import RawEvents

__all__ = ["LiveOdometry", "RawEvents"]
