"""Contours are seen behind where they are, by half of the threshold over the gradient."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from shown_events import shown

from gpvo.config.stages import CompensationConfig
from gpvo.events import StereoCluster
from gpvo.tracking import Observations
from gpvo.tracking.contour_lag import ContourLag
from gpvo.tracking.event_sums import Flow
from gpvo.tracking.motion_compensation import MotionCompensation

WAVELENGTH, AMPLITUDE = 10.0, 0.6


def flow(u: float, v: float) -> Flow:
    return np.full((1, 1, 2), (u, v), np.float32)


def events_of_a_pixel(places: NDArray[np.float64], threshold: float) -> NDArray[np.float64]:
    """Return the places of a wave, as they pass a pixel, at which it has an event."""
    seen, events = AMPLITUDE * np.sin(2 * np.pi * places / WAVELENGTH), []
    last = float(seen[0])
    for place, value in zip(places.tolist(), seen.tolist(), strict=True):
        while abs(value - last) >= threshold:
            last += math.copysign(threshold, value - last)
            events.append(place)
    return np.array(events)


@pytest.mark.parametrize("threshold", [0.05, 0.1, 0.2, 0.3])
def test_the_events_of_a_slope_come_late_by_half_a_threshold(threshold: float) -> None:
    """They are where the brightness is C / 2 farther than in the middle of the slope."""
    late = []
    for start in np.linspace(0, 1, 40):  # all phases of the last event before
        places = np.arange(start, start + 10 * WAVELENGTH, 0.002)
        events = events_of_a_pixel(places, threshold)[20:]
        # Slopes are half a wavelength long, with their middles at its multiples.
        late.append((events + WAVELENGTH / 4) % (WAVELENGTH / 2) - WAVELENGTH / 4)
    brightness = AMPLITUDE * np.sin(2 * np.pi * np.concatenate(late) / WAVELENGTH)
    assert brightness.mean() == pytest.approx(threshold / 2, rel=0.15)


def test_the_lag_turns_with_the_way_and_not_with_the_time() -> None:
    lag = ContourLag(0.3)
    lag.follow(flow(50.0, 0.0), 1.0)
    np.testing.assert_allclose(lag.ahead(np.zeros((1, 2))), [[0.3, 0.0]], atol=1e-6)
    lag.follow(flow(-0.1, 0.0), 1.0)  # a tenth of a pixel: it does not turn round at once
    assert 0.1 < lag.ahead(np.zeros((1, 2)))[0, 0] < 0.3
    lag.follow(flow(0.0, 0.0), 100.0)
    assert 0.1 < lag.ahead(np.zeros((1, 2)))[0, 0] < 0.3
    lag.follow(flow(0.0, -400.0), 0.1)
    np.testing.assert_allclose(lag.ahead(np.zeros((1, 2))), [[0.0, -0.3]], atol=1e-6)


def test_without_motion_nothing_is_known_of_the_lag() -> None:
    np.testing.assert_array_equal(ContourLag(0.3).ahead(np.ones((3, 2))), np.zeros((3, 2)))


def test_observations_are_moved_ahead_by_the_lag() -> None:
    motion, count = np.array([40.0, 30.0]), 12
    places = np.random.default_rng(3).uniform([15, 12], [65, 48], (count, 2))
    moved = []
    for lag in (0.0, 0.25):
        compensation = MotionCompensation(CompensationConfig(lag=lag), frames=3)
        for number in range(3):
            t = 0.06 * number + np.repeat([0.02, 0.03, 0.04], count)
            events = shown(np.tile(places, (3, 1)) + t[:, None] * motion, t, (60, 80))
            cluster = StereoCluster(0.06 * number, 0.06 * (number + 1), events, events)
            compensation.pictures(cluster)
            seen = places + (0.06 * number + 0.03) * motion
            numbers = np.arange(count), np.full(count, number)
            moved.append(compensation.timed(Observations(*numbers, seen, seen - [5.0, 0.0])))
    without, with_lag = moved[2], moved[5]
    ahead = np.tile(0.25 * motion / np.linalg.norm(motion), (count, 1))
    np.testing.assert_allclose(with_lag.left - without.left, ahead, atol=1e-3)
    np.testing.assert_allclose(with_lag.disparity, without.disparity, atol=1e-9)
