"""What is drawn: event images of two colours, and tracks of one length."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from gpvo.events.clusters import ClusterEvents
from gpvo.recordings import Events
from gpvo.tracking.measurements import Measurements
from gpvo.view.event_image import COLOURS, event_image
from gpvo.view.tracks import LONGEST, OLD_COLOUR, OUTLIER, YOUNG_COLOUR, TrackHistory


def test_the_latest_event_of_a_rectified_pixel_is_drawn_and_none_outside() -> None:
    table = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), axis=-1).astype(np.float32)
    table[0, 0], table[0, 1], table[0, 2] = np.nan, -0.6, (3.6, 0.0)
    x, y = np.array([0, 1, 2, 1, 1, 3], np.uint16), np.array([0, 0, 0, 2, 2, 1], np.uint16)
    polarity = np.array([1, 1, 1, 1, 0, 1], np.bool_)
    events = Events(t=np.linspace(0, 1, 6), x=x, y=y, polarity=polarity)
    white = np.tile(COLOURS[0], (3, 4, 1))
    white[2, 1], white[1, 3] = COLOURS[2], COLOURS[1]
    np.testing.assert_array_equal(event_image(ClusterEvents((events,), table, (4, 3))), white)


def seen(landmarks: list[int], t: float) -> Measurements:
    """Measure landmark k at the pixel (k + t, k) with the disparity 1 + k."""
    k = np.array(landmarks, np.float64)
    stereo = np.column_stack([k + t, k, 1 + k])
    return Measurements(
        np.array(landmarks, np.int64), np.zeros(len(k), np.int64), np.full(len(k), t), stereo
    )


def cluster(landmarks: list[int], t: float, inliers: list[bool]) -> Any:
    later, earlier = seen(landmarks, t), seen(landmarks, t - 0.1)
    return SimpleNamespace(earlier=earlier, later=later, inliers=np.array(inliers))


def test_tracks_hold_the_last_pixels_of_each_landmark_that_is_seen() -> None:
    history = TrackHistory()
    history.add(cluster([5, 7], 0.1, [True, True]))
    tracks = history.add(cluster([9, 7], 0.2, [False, True]))
    assert tracks.left.shape == tracks.right.shape == (2, LONGEST, 2)
    np.testing.assert_allclose(tracks.left[1, -3:, 0], [7.0, 7.1, 7.2])
    np.testing.assert_allclose(tracks.left[0, -3:, 0], [9.1, 9.1, 9.2])
    for track, disparity in enumerate((10, 8)):
        apart = tracks.left[track] - tracks.right[track]
        np.testing.assert_allclose(apart, [[disparity, 0]] * LONGEST)
    np.testing.assert_allclose(tracks.age, [0.1, 0.2])
    np.testing.assert_array_equal(tracks.colours[0], OUTLIER)

    for k in range(3, 3 + LONGEST):
        tracks = history.add(cluster([7], k / 10, [True]))
    np.testing.assert_allclose(tracks.left[0, :, 0], 7 + np.arange(3, 3 + LONGEST) / 10)
    np.testing.assert_array_equal(tracks.colours, [OLD_COLOUR])


def test_young_tracks_are_light() -> None:
    tracks = TrackHistory().add(cluster([1], 0.1, [True]))
    mixed = np.array(YOUNG_COLOUR) + 0.2 * (np.array(OLD_COLOUR) - YOUNG_COLOUR)
    np.testing.assert_allclose(tracks.colours, [mixed], atol=0.5)
