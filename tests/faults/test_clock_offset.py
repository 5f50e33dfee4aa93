"""The offset of the cameras' clocks, however far the cameras are apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from gpvo.recordings import Events, Recording, StereoEvents, StereoRig, open_recording
from gpvo.recordings.calibration.unknown import UNKNOWN_RIG
from gpvo.recordings.event_batches import stereo_batches
from gpvo.recordings.right_offset import found_offset
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate
from gpvo.simulation.motion import Motion

SIZE = np.array([320, 240])
RIG = SimulationConfig(resolution=(320, 240), focal_length=200.0).rig
SHARED = Path(__file__).resolve().parents[3] / "shared/recordings"


@cache
def contours(
    farthest: float, seed: int, climb: float = 0.0, duration: float = 3.0
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
    return sides[0], sides[1]


def later(events: Events, seconds: float) -> Events:
    return replace(events, t=events.t + seconds)


class Streams(Recording):
    """A recording in memory."""

    def __init__(self, left: Events, right: Events, rig: StereoRig = UNKNOWN_RIG) -> None:
        self.path, self.start_ns, self.rig = Path("streams"), 0, rig
        self.duration = float(min(left.t[-1], right.t[-1]))
        self._sides = left, right

    def event_batches(self, start: float = 0.0, stop: float = np.inf) -> Iterator[StereoEvents]:
        start, stop = max(start, 0.0), min(stop, self.duration)
        sides = (iter([side.between(start, stop)]) for side in self._sides)
        return stereo_batches(*sides, start, stop, 0.1)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("farthest", [10.0, 150.0])
@pytest.mark.parametrize("late", [0.0, -0.02, 0.05, 0.3])
@pytest.mark.parametrize("rig", [UNKNOWN_RIG, RIG], ids=["uncalibrated", "calibrated"])
def test_the_offset_does_not_depend_on_the_baseline(
    rig: StereoRig, late: float, farthest: float, seed: int
) -> None:
    """Contours reach the right image's border up to a second before the left one's."""
    left, right = contours(farthest, seed)
    found = found_offset(Streams(left, later(right, late), rig))
    assert found is not None
    assert abs(found.seconds - late) < 3 * found.deviation and found.deviation < 0.006
    assert found.is_apart == (late != 0)


@pytest.fixture(scope="module")
def turning() -> SimulatedRecording:
    """A camera that goes round a circle at constant rate, 10 s a round, looking ahead."""
    times = np.linspace(-1.0, 4.0, 101)
    angle = 2 * np.pi * times / 10.0
    circle = np.stack([1.5 * np.sin(angle), -1.5 * np.cos(angle), 0.0 * angle], axis=1)
    ahead = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turned = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]) * ahead
    motion = Motion(CubicSpline(times, circle), RotationSpline(times, turned))
    config = SimulationConfig(resolution=(240, 180), focal_length=157.0, duration=2.0, seed=1)
    return simulate(config, motion)


@pytest.mark.parametrize("late", [0.0, 0.03])
def test_a_constant_turn_tells_no_offset(turning: SimulatedRecording, late: float) -> None:
    """Disparity / image speed looks like one: contours enter and leave the right rows later."""
    found = found_offset(Streams(turning.left, later(turning.right, late), turning.rig))
    assert found is None or not found.is_apart or abs(found.seconds - late) < 3 * found.deviation


@pytest.mark.parametrize("rows", [4, 8])
@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("rig", [UNKNOWN_RIG, RIG], ids=["uncalibrated", "calibrated"])
def test_rows_that_differ_are_no_offset(rig: StereoRig, rows: int, seed: int) -> None:
    """A calibration that is wrong by some rows looks late while the image moves up or down."""
    left, right = contours(10.0, seed, climb=200.0)
    lower = replace(right, y=np.minimum(right.y + rows, SIZE[1] - 1).astype(np.uint16))
    for side in (right, lower):
        found = found_offset(Streams(left, side, rig))
        assert found is None or not found.is_apart


@pytest.fixture(
    scope="module",
    params=[
        ("room1_indoor1", "camchain-imucam-indoor_flying.yaml"),
        ("street22", "street22_camchain.yaml"),
    ],
    ids=lambda files: files[0],
)
def larger(request: pytest.FixtureRequest) -> tuple[Events, Events, StereoRig]:
    """The first two seconds of a recording."""
    if not SHARED.is_dir():
        pytest.skip("the shared folder of recordings is not here")
    name, calibration = request.param
    recording = open_recording(SHARED / f"{name}_data.hdf5", SHARED / calibration)
    batches = list(recording.event_batches(0.0, 2.1))
    left, right = (
        Events.concatenate(getattr(batch, side) for batch in batches) for side in ("left", "right")
    )
    return left, right, recording.rig


@pytest.mark.parametrize("late", [0.0, 0.03])
def test_larger_recordings(late: float, larger: tuple[Events, Events, StereoRig]) -> None:
    """Street22 has disparities of 5 to 100 pixels; its rates alone look 20 ms late."""
    left, right, rig = larger
    found = found_offset(Streams(left, later(right, late), rig))
    assert found is not None and abs(found.seconds - late) < 3 * found.deviation
    assert found.is_apart == (late != 0)
