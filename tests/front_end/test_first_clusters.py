"""The first two clusters are tracked again with sharp pictures if contours moved far."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from front_end_scenes import CAMERA, HEIGHT, WIDTH, Texture
from numpy.typing import NDArray
from shown_events import shown

from gpvo.config import TrackingConfig
from gpvo.events import ClusterEvents, StereoCluster
from gpvo.tracking import MultiResolutionTracker, Observations, motion_compensation

STEP, DISPARITY = 0.1, 10.0
"""Seconds between clusters, and pixels."""
NEAR = 0.1
"""Value of the texture up to which a pixel is part of a contour."""


@cache
def contour_pixels() -> NDArray[np.float64]:
    """Return the pixels (N, 2) of contours, in view and a width beside it."""
    v, u = np.mgrid[0:HEIGHT, -WIDTH : 2 * WIDTH].astype(np.float64)
    on = np.abs(Texture(7)(u, v)) < NEAR
    return np.stack([u[on], v[on]], axis=1)


def events(number: int, speed: float, shift: float) -> ClusterEvents:
    """Simulate contours that move to the right, pixels per second, each at random times."""
    rng = np.random.default_rng(number)
    points = np.repeat(contour_pixels(), 5, axis=0)
    t = np.sort(rng.uniform(STEP * number, STEP * (number + 1), len(points)))
    points = rng.permutation(points) + t[:, None] * [speed, 0.0] - [shift, 0.0]
    seen = np.all((points >= 0) & (points <= [WIDTH - 1, HEIGHT - 1]), axis=1)
    return shown(points[seen], t[seen], (HEIGHT, WIDTH))


def track(speed: float) -> list[Observations]:
    tracking = MultiResolutionTracker(TrackingConfig(resolutions=(1,)), CAMERA)
    return [
        tracking.track(
            StereoCluster(
                STEP * k, STEP * (k + 1), *(events(k, speed, shift) for shift in (0.0, DISPARITY))
            )
        )
        for k in range(4)
    ]


def scatter(seen: Observations, speed: float) -> float:
    """Compute the typical distance of landmarks from the true motion since the first cluster."""
    first, second = seen[seen.frame == 0], seen[seen.frame == 1]
    _, i, j = np.intersect1d(first.landmark, second.landmark, return_indices=True)
    assert len(i) > 50
    dt = (second.times[j] - first.times[i])[:, :1]
    error = second.left[j] - first.left[i] - dt * [speed, 0.0]
    return float(np.median(np.linalg.norm(error, axis=1)))


def test_fast_starts_are_sharp(monkeypatch: pytest.MonkeyPatch) -> None:
    speed = 120.0
    again = Observations.concatenate(track(speed))
    monkeypatch.setattr(motion_compensation, "BLURRED", np.inf)
    once = Observations.concatenate(track(speed))
    assert scatter(again, speed) < 0.2 * scatter(once, speed)
    pairs = np.stack([again.landmark, again.frame], axis=1)
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    assert again.frame.min() == 0 and again.frame.max() == 3


def test_slow_starts_are_tracked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    as_usual = track(20.0)
    monkeypatch.setattr(motion_compensation, "BLURRED", np.inf)
    for seen, once in zip(as_usual, track(20.0), strict=True):
        np.testing.assert_array_equal(seen.left, once.left)
        np.testing.assert_array_equal(seen.landmark, once.landmark)
