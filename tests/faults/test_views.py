"""Swapped and shifted cameras, in pictures that are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from gpvo.events import ClusterEvents, StereoCluster
from gpvo.faults.views import Views, correlation, picture
from gpvo.recordings import Events

WIDTH, HEIGHT, MARGIN = 160, 120, 40
TABLE = np.dstack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))).astype(np.float32)


def camera(columns: int, rows: int, seed: int, noise: float = 0.02) -> ClusterEvents:
    """See a texture of contours, shifted right and down, and noise."""
    shape = HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN
    texture = np.random.default_rng(5).standard_normal(shape).astype(np.float32)
    smooth = cv2.GaussianBlur(texture, (0, 0), 4)
    edges = np.abs(smooth) < 0.15 * smooth.std()
    seen = np.roll(edges, (rows, columns), (0, 1))[MARGIN:-MARGIN, MARGIN:-MARGIN].copy()
    seen |= np.random.default_rng(seed).random(seen.shape) < noise
    y, x = (index.astype(np.uint16) for index in np.nonzero(seen))
    events = Events(x, y, np.zeros(len(x)), np.ones(len(x), bool))
    return ClusterEvents((events,), TABLE, (WIDTH, HEIGHT))


def said(columns: int, rows: int) -> list[str]:
    views, found = Views(), []
    for number in range(8):
        left, right = camera(0, 0, 2 * number), camera(columns, rows, 2 * number + 1)
        found += list(views.see(StereoCluster(0.2 * number, 0.2 * number + 0.2, left, right)))
    return [fault.kind for fault in found]


@pytest.mark.parametrize("disparity", [0, 2, 9, 30])
def test_nothing_is_said_of_a_sound_pair(disparity: int) -> None:
    assert said(-disparity, 0) == []


@pytest.mark.parametrize("disparity", [4, 30])
def test_swapped_cameras_are_named(disparity: int) -> None:
    assert said(disparity, 0) == ["cameras swapped"]


@pytest.mark.parametrize("rows", [-9, 3, 14])
def test_a_shift_up_or_down_is_named(rows: int) -> None:
    assert said(-10, rows) == ["rows differ"]


def test_the_correlation_of_a_shifted_picture_is_one_at_its_shift() -> None:
    image = np.zeros((60, 90))
    image[20:30, 30:45] = np.random.default_rng(0).standard_normal((10, 15))
    found = correlation(image, np.roll(image, (5, -7), (0, 1)))
    assert found[16 + 5, 30 - 7] == pytest.approx(1.0) and found.max() == pytest.approx(1.0)


def test_pictures_of_large_sensors_are_small() -> None:
    assert picture(camera(0, 0, 1), 2).shape == (HEIGHT // 2, WIDTH // 2)
