"""Simulated recordings: events add up to the change of brightness, and files give them back."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from pydantic import ValidationError

from gpvo.errors import InputError
from gpvo.recordings import Events, StereoRig
from gpvo.recordings.files.mvsec import MvsecRecording
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate
from gpvo.simulation.motion import Motion
from gpvo.simulation.scene import pixel_grid, pixel_rays
from gpvo.trajectory import StampedPoses

SMALL = SimulationConfig(
    seed=7, motion="fast", duration=0.3, resolution=(80, 60), focal_length=52.0
)


def changed(**changes: object) -> SimulationConfig:
    return SMALL.model_copy(update=changes)


@pytest.fixture(scope="module")
def recording() -> SimulatedRecording:
    return simulate(SMALL)


def arrays(events: Events) -> tuple[np.ndarray, ...]:
    return events.x, events.y, events.t, events.polarity


def test_one_seed_gives_one_recording(recording: SimulatedRecording) -> None:
    again, other = simulate(SMALL), simulate(changed(seed=8))
    for side in ("left", "right"):
        first, second = arrays(getattr(recording, side)), arrays(getattr(again, side))
        assert all(a.tobytes() == b.tobytes() for a, b in zip(first, second, strict=True))
        assert first[2].tobytes() != getattr(other, side).t.tobytes()
    truth = recording.ground_truth.T_world_cam
    assert truth.tobytes() == again.ground_truth.T_world_cam.tobytes()
    assert truth.tobytes() != other.ground_truth.T_world_cam.tobytes()


def test_stillness_makes_no_events_and_noise_its_rate() -> None:
    still = simulate(changed(motion="still"))
    assert len(still.left) == len(still.right) == still.duration == 0
    assert next(still.event_batches()).left.t.size == 0
    noisy = simulate(changed(motion="still", noise_rate=5.0))
    expected = 5.0 * 80 * 60 * SMALL.duration
    for side in (noisy.left, noisy.right):
        assert abs(len(side) - expected) < 5 * np.sqrt(expected)
        assert abs(side.polarity.mean() - 0.5) < 2.5 / np.sqrt(expected)
        check_stream(side)


def sideways(seconds: float) -> Motion:
    """Return a motion along y that is known for so long."""
    stamps = np.linspace(0.0, 1e9 * seconds, 5).astype(np.int64)
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 1, 3] = np.linspace(0.0, 0.5, 5)
    return Motion.through(StampedPoses(stamps, poses))


def test_motion_that_ends_too_early_is_refused() -> None:
    """Beyond its last pose a spline leads hundreds of metres away."""
    with pytest.raises(
        InputError, match=r"duration: 0\.3 s is longer than the motion.* for 0\.2 s"
    ):
        simulate(SMALL, sideways(0.2))
    with pytest.raises(InputError, match="two poses or more, not 1"):
        Motion.through(StampedPoses(np.zeros(1, np.int64), np.eye(4)[None]))


def test_both_cameras_stay_inside_the_room() -> None:
    """A camera in a wall or box would see nothing that is there."""
    with pytest.raises(InputError, match="the right camera, with a baseline of 3 m, leaves"):
        simulate(changed(baseline=3.0))
    wide = simulate(changed(baseline=3.0, duration=0.05), sideways(0.2))
    x = wide.ground_truth.positions[:, 0] + 3.0
    assert x.max() < wide.scene.boxes[0, 1, 0] - 2.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"resolution": (65535, 65535)},
        {"focal_length": 1e-300},
        {"threshold": 1e-9},
        {"noise_rate": 1e12},
        {"boxes": 10**9},
        {"pixels_per_frame": 1e-9},
        {"duration": 1e9},
    ],
)
def test_what_would_fill_memory_or_never_end_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        SimulationConfig.model_validate(wrong)


def check_stream(events: Events) -> None:
    assert (np.diff(events.t) >= 0).all() and events.t[0] >= 0
    assert events.x.max() < 80 and events.y.max() < 60
    np.testing.assert_array_equal(events.t, np.rint(events.t * 1e6) / 1e6)


def test_streams_are_sorted_inside_the_sensor_and_microseconds(
    recording: SimulatedRecording,
) -> None:
    for side in (recording.left, recording.right):
        check_stream(side)
        assert len(side) > 2000 and 0.2 < side.polarity.mean() < 0.8
    assert min(recording.left.t[0], recording.right.t[0]) == 0.0
    assert max(recording.left.t[-1], recording.right.t[-1]) == recording.duration


def test_pixels_are_silent_in_the_refractory_period(recording: SimulatedRecording) -> None:
    events = recording.left
    order = np.lexsort((events.t, events.x, events.y))
    same = (np.diff(events.x[order]) == 0) & (np.diff(events.y[order]) == 0)
    gaps = np.diff(events.t[order])[same]
    assert gaps.min() >= SMALL.refractory_period - 1.5e-6


@pytest.mark.parametrize("side", ["left", "right"])
def test_events_sum_up_to_the_change_of_log_intensity(side: str) -> None:
    """With equal thresholds and no refractory period, sums differ by less than a threshold."""
    recording = simulate(changed(threshold_sigma=0.0, refractory_period=0.0))
    events: Events = getattr(recording, side)
    summed = np.zeros((60, 80))
    np.add.at(summed, (events.y, events.x), np.where(events.polarity, 0.25, -0.25))

    rays = pixel_rays(pixel_grid(np.arange(80.0), np.arange(60.0)), recording.rig.K_rect)
    T_left_cam = np.eye(4)
    T_left_cam[0, 3] = SMALL.baseline if side == "right" else 0.0
    truth = recording.ground_truth.T_world_cam[[0, -1]] @ T_left_cam
    before, after = (recording.scene.look(rays, 1 / 52.0, T)[0] for T in truth)
    change = (after - before).reshape(60, 80)
    assert np.abs(summed - change).max() < 0.25
    assert np.abs(change).max() > 0.75


def test_ground_truth_is_the_motion_at_200_hz(recording: SimulatedRecording) -> None:
    truth = recording.ground_truth
    np.testing.assert_allclose(np.diff(truth.stamps_ns), 5_000_000)
    assert truth.stamps_ns[0] <= recording.start_ns
    assert truth.stamps_ns[-1] >= recording.stamp_ns(recording.duration)
    t = (truth.stamps_ns - recording.start_ns) * 1e-9
    np.testing.assert_allclose(recording.motion.pose(t), truth.T_world_cam, atol=1e-9)


def test_batches_hold_every_event_once(recording: SimulatedRecording) -> None:
    batches = list(recording.event_batches())
    for side in ("left", "right"):
        whole = Events.concatenate([getattr(batch, side) for batch in batches])
        expected = arrays(getattr(recording, side))
        assert all(map(np.array_equal, arrays(whole), expected))
    part = list(recording.event_batches(0.1, 0.15))
    assert (part[0].start, part[-1].stop) == (0.1, 0.15)
    assert sum(len(batch.left) for batch in part) == len(recording.left.between(0.1, 0.15))


def test_mvsec_files_give_the_recording_back(recording: SimulatedRecording, tmp_path: Path) -> None:
    recording.write_mvsec(tmp_path)
    name = recording.path.name
    read = MvsecRecording(tmp_path / f"{name}_data.hdf5", tmp_path / f"camchain-{name}.yaml")
    assert read.start_ns == recording.start_ns
    assert read.duration == pytest.approx(recording.duration, abs=1e-9)
    check_same_rig(read.rig, recording.rig)
    batches = list(read.event_batches())
    for side in ("left", "right"):
        expected: Events = getattr(recording, side)
        events = Events.concatenate([getattr(batch, side) for batch in batches])
        np.testing.assert_allclose(events.t, expected.t, atol=1e-9)
        for field in ("x", "y", "polarity"):
            np.testing.assert_array_equal(getattr(events, field), getattr(expected, field))
    with h5py.File(tmp_path / f"{name}_gt.hdf5") as file:
        np.testing.assert_array_equal(file["davis/left/pose"], recording.ground_truth.T_world_cam)
        stamps = np.rint(np.asarray(file["davis/left/pose_ts"]) * 1e9).astype(np.int64)
    np.testing.assert_array_equal(stamps, recording.ground_truth.stamps_ns)


def check_same_rig(read: StereoRig, written: StereoRig) -> None:
    np.testing.assert_allclose(read.K_rect, written.K_rect)
    assert read.baseline == pytest.approx(written.baseline)
    assert read.resolution == written.resolution
    for table, expected in zip(read.tables, written.tables, strict=True):
        np.testing.assert_allclose(table, expected, atol=1e-4)
        rows, columns = np.mgrid[0:60, 0:80]
        np.testing.assert_allclose(table, np.stack([columns, rows], axis=2), atol=1e-4)
