"""The offset of the cameras' clocks, however far the cameras are apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gpvo.recordings import Events, Recording, StereoEvents, open_recording
from gpvo.recordings.calibration.unknown import UNKNOWN_RIG
from gpvo.recordings.event_batches import stereo_batches
from gpvo.recordings.right_offset import found_offset

SIZE = np.array([320, 240])
SHARED = Path(__file__).resolve().parents[3] / "shared/recordings"


def contours(
    late: float, farthest: float, seed: int, climb: float = 0.0, duration: float = 3.0
) -> tuple[Events, Events]:
    """Make events of points that move together as a turning camera sees them.

    Their disparities are up to `farthest` pixels; each makes an event where it enters a pixel. The
    image moves by 120 pixels/s to the right on average, and by `climb` down.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1e-3)
    walk = np.cumsum(
        rng.normal(0, 1, (2, 3, 1))
        * np.cos(2 * np.pi * rng.uniform(0.5, 3, (2, 3, 1)) * t + rng.uniform(0, 6, (2, 3, 1))),
        axis=2,
    ).sum(axis=1)
    motion = 0.25 * walk + np.array([[120.0], [climb]]) * t
    points = rng.uniform([-900, -100], [700, 340], (1500, 2))
    disparity = rng.uniform(0.1, 1.0, 1500) * farthest
    sides = []
    for shift in (0.0, disparity):
        x = points[:, :1] + motion[0] - np.reshape(shift, (-1, 1))
        y = points[:, 1:] + motion[1]
        moved = (np.diff(np.floor(x)) != 0) | (np.diff(np.floor(y)) != 0)
        inside = (x >= 0) & (x < SIZE[0]) & (y >= 0) & (y < SIZE[1])
        point, time = np.nonzero(moved & inside[:, 1:])
        order = np.argsort(time, kind="stable")
        point, time = point[order], time[order] + 1
        pixels = (np.floor(a[point, time]).astype(np.uint16) for a in (x, y))
        sides.append(Events(*pixels, t[time], point % 2 == 0))
    return sides[0], replace(sides[1], t=sides[1].t + late)


class Streams(Recording):
    """A recording in memory."""

    def __init__(self, left: Events, right: Events) -> None:
        self.path, self.start_ns, self.rig = Path("streams"), 0, UNKNOWN_RIG
        self.duration = float(min(left.t[-1], right.t[-1]))
        self._sides = left, right

    def event_batches(self, start: float = 0.0, stop: float = np.inf) -> Iterator[StereoEvents]:
        start, stop = max(start, 0.0), min(stop, self.duration)
        sides = (iter([side.between(start, stop)]) for side in self._sides)
        return stereo_batches(*sides, start, stop, 0.1)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("farthest", [10.0, 150.0])
@pytest.mark.parametrize("late", [0.0, -0.02, 0.05, 0.3])
def test_the_offset_does_not_depend_on_the_baseline(
    late: float, farthest: float, seed: int
) -> None:
    """Contours reach the right image's border up to a second before the left one's."""
    found = found_offset(Streams(*contours(late, farthest, seed)))
    assert found is not None
    assert abs(found.seconds - late) < 3 * found.deviation and found.deviation < 0.006
    assert found.is_apart == (late != 0)


@pytest.mark.parametrize("rows", [4, 8])
@pytest.mark.parametrize("seed", [0, 3])
def test_rows_that_differ_are_no_offset(rows: int, seed: int) -> None:
    """A calibration that is wrong by some rows looks late while the image moves up or down."""
    left, right = contours(0.0, 10.0, seed, climb=200.0)
    lower = replace(right, y=(right.y + rows).astype(np.uint16))
    for side in (right, lower):
        found = found_offset(Streams(left, side))
        assert found is None or not found.is_apart


@pytest.mark.parametrize("late", [0.0, 0.03])
@pytest.mark.parametrize(
    ("name", "calibration"),
    [
        ("room1_indoor1", "camchain-imucam-indoor_flying.yaml"),
        ("street22", "street22_camchain.yaml"),
    ],
)
def test_larger_recordings(late: float, name: str, calibration: str) -> None:
    """Street22 has disparities of 5 to 100 pixels; its rates alone look 20 ms late."""
    if not SHARED.is_dir():
        pytest.skip("the shared folder of recordings is not here")
    recording = open_recording(SHARED / f"{name}_data.hdf5", SHARED / calibration)
    batches = list(recording.event_batches(0.0, 2.1))
    left, right = (
        Events.concatenate(getattr(batch, side) for batch in batches) for side in ("left", "right")
    )
    streams = Streams(left, replace(right, t=right.t + late))
    streams.rig = recording.rig
    found = found_offset(streams)
    assert found is not None and abs(found.seconds - late) < 3 * found.deviation
    assert found.is_apart == (late != 0)
