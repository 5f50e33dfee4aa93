"""Simulate events where the log intensity of finely spaced frames crosses a threshold.

The model is that of ESIM (Rebecq et al., CoRL 2018): log intensity is linear in time between
frames, and the spacing of the frames follows the image motion.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from factors.kernels.compiled import kernel
from gpvo.recordings import Events
from gpvo.simulation.config import SimulationConfig
from gpvo.simulation.motion import Motion
from gpvo.simulation.scene import Scene, pixel_grid, pixel_rays

Array = NDArray[np.float64]

_LONGEST_STEP = 0.010
"""Seconds between frames of a camera that hardly moves."""


def frame_times(scene: Scene, motion: Motion, config: SimulationConfig) -> Array:
    """Return frame times from 0 to the motion's duration, seconds.

    Between frames, image points move by about `pixels_per_frame` at most. The image motion is that
    of a coarse grid of pixels at their exact depths.
    """
    (width, height), duration = config.resolution, config.duration
    pixels = pixel_grid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 7))
    rays, f = pixel_rays(pixels, config.rig.K_rect), config.focal_length
    ticks = np.linspace(0.0, duration, int(np.ceil(duration / _LONGEST_STEP)) + 1)
    speeds = []
    for pose, twist in zip(motion.pose(ticks), motion.twist(ticks), strict=True):
        _, depth = scene.look(rays, 1.0 / f, pose)
        speeds.append(f * _image_speed(rays, depth, twist).max())
    slowest = config.pixels_per_frame / _LONGEST_STEP
    path = cumulative_trapezoid(np.maximum(speeds, slowest), ticks, initial=0.0)
    frames = int(np.ceil(path[-1] / config.pixels_per_frame)) + 1
    return np.interp(np.linspace(0.0, path[-1], frames), path, ticks)


def _image_speed(rays: Array, depth: Array, twist: Array) -> Array:
    """Return the image speed (N,) at unit depth of static points for a body twist of the camera."""
    points = np.column_stack([rays, np.ones(len(rays))]) * depth[:, None]
    velocity = -np.cross(twist[:3], points) - twist[3:]
    flow = (velocity[:, :2] - rays * velocity[:, 2:]) / depth[:, None]
    return np.hypot(flow[:, 0], flow[:, 1])


def simulate_events(
    scene: Scene,
    config: SimulationConfig,
    times: Array,
    poses: Array,
    rng: np.random.Generator,
) -> Iterator[Events]:
    """Yield the events between consecutive frames at times (N,), seconds.

    The camera is at the poses T_world_cam (N, 4, 4). Times of events are whole microseconds.
    """
    width, height = config.resolution
    pixels = pixel_grid(np.arange(float(width)), np.arange(float(height)))
    rays, pixel_angle = pixel_rays(pixels, config.rig.K_rect), 1.0 / config.focal_length
    thresholds = _thresholds(config, rng)
    before, _ = scene.look(rays, pixel_angle, poses[0])
    reference, last = before.astype(np.float64), np.full(config.pixels, -np.inf)
    for start, stop, pose in zip(times[:-1], times[1:], poses[1:], strict=True):
        now, _ = scene.look(rays, pixel_angle, pose)
        bound = config.pixels + int(np.abs(now - reference).sum() / thresholds.min())
        pixel, t, on = np.empty(bound, np.int64), np.empty(bound), np.empty(bound, np.bool_)
        period = config.refractory_period
        n = _cross(before, now, start, stop, thresholds, period, reference, last, pixel, t, on)
        noise = _noise(config, start, stop, rng)
        parts = zip((pixel[:n], t[:n], on[:n]), noise, strict=True)
        yield _in_order(width, *(np.concatenate(part) for part in parts))
        before = now


def _thresholds(config: SimulationConfig, rng: np.random.Generator) -> Array:
    """Draw OFF and ON thresholds (2, pixels), at least a tenth of their mean."""
    drawn = rng.normal(config.threshold, config.threshold_sigma, (2, config.pixels))
    return np.maximum(drawn, 0.1 * config.threshold)


def _noise(
    config: SimulationConfig, start: float, stop: float, rng: np.random.Generator
) -> tuple[NDArray[np.int64], Array, NDArray[np.bool_]]:
    """Draw pixels, times and polarities of the background noise in [start, stop)."""
    n = rng.poisson(config.noise_rate * config.pixels * (stop - start))
    return rng.integers(config.pixels, size=n), rng.uniform(start, stop, n), rng.random(n) < 0.5


def _in_order(width: int, pixel: NDArray[np.int64], t: Array, on: NDArray[np.bool_]) -> Events:
    """Return the events of one step in time order, in whole microseconds."""
    order = np.argsort(t, kind="stable")
    y, x = np.divmod(pixel[order], width)
    seconds = np.rint(t[order] * 1e6) / 1e6
    return Events(x.astype(np.uint16), y.astype(np.uint16), seconds, on[order])


@kernel
def _cross(
    before: NDArray[np.float32],
    now: NDArray[np.float32],
    start: float,
    stop: float,
    thresholds: Array,
    refractory_period: float,
    reference: Array,
    last: Array,
    pixel: NDArray[np.int64],
    t: Array,
    on: NDArray[np.bool_],
) -> int:
    """Write the step's events, pixel by pixel, and return their number.

    `reference` is the log intensity at each pixel's last crossing, `last` the time of its last
    event; both are updated. A crossing in the refractory period moves the reference without an
    event.
    """
    n = 0
    for i in range(len(now)):
        brighter = now[i] > before[i]
        sign, threshold = (1.0, thresholds[1, i]) if brighter else (-1.0, thresholds[0, i])
        while sign * (now[i] - reference[i]) >= threshold:
            reference[i] += sign * threshold
            share = (reference[i] - before[i]) / (now[i] - before[i])
            crossing = start + min(max(share, 0.0), 1.0) * (stop - start)
            if crossing - last[i] >= refractory_period:
                pixel[n], t[n], on[n] = i, crossing, brighter
                last[i] = crossing
                n += 1
    return n
