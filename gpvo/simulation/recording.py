"""Stereo event recordings of simulated motions, with exact ground truth."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.mapping.scene_file import write_scene
from gpvo.recordings import Events, Recording, StereoEvents, StereoRig
from gpvo.recordings.event_batches import stereo_batches
from gpvo.recordings.writing.hdf5 import MvsecWriter
from gpvo.recordings.writing.writer import stamped, write_camchain
from gpvo.simulation.config import SimulationConfig
from gpvo.simulation.events import frame_times, simulate_events
from gpvo.simulation.motion import Motion
from gpvo.simulation.scene import Scene
from gpvo.trajectory import StampedPoses

START_NS = 1_000_000_000_000
"""Absolute stamp of the start of every simulation; small enough for exact float64 seconds."""

GROUND_TRUTH_RATE = 200
"""Number of poses per second."""


@dataclass(frozen=True, eq=False)
class SimulatedRecording(Recording):
    """A simulated recording in memory.

    Attributes
    ----------
    left, right
        All events, t = 0 at the first event of either camera.
    ground_truth
        Exact T_world_cam of the left camera at 200 Hz.
    motion
        The left camera's motion, with the same t as the events.
    scene
        Scene that the cameras saw.
    """

    path: Path
    rig: StereoRig
    start_ns: int
    duration: float
    left: Events
    right: Events
    ground_truth: StampedPoses
    motion: Motion
    scene: Scene

    def event_batches(self, start: float = 0.0, stop: float = np.inf) -> Iterator[StereoEvents]:
        start, stop = self.within(start, stop)
        left, right = (iter([side.between(start, stop)]) for side in (self.left, self.right))
        return stereo_batches(left, right, start, stop)

    def write_mvsec(self, folder: Path) -> None:
        """Write NAME_data.hdf5, NAME_gt.hdf5, NAME_scene.npz and camchain-NAME.yaml.

        NAME is the path's name; the scene is its surface.
        """
        folder.mkdir(parents=True, exist_ok=True)
        name, sizes = self.path.name, (self.rig.left.resolution, self.rig.right.resolution)
        with MvsecWriter(folder / f"{name}_data.hdf5", sizes, self.start_ns) as writer:
            writer.append(stamped(self.left, self.start_ns), stamped(self.right, self.start_ns))
        with h5py.File(folder / f"{name}_gt.hdf5", "w") as file:
            file["davis/left/pose"] = self.ground_truth.T_world_cam
            file["davis/left/pose_ts"] = self.ground_truth.stamps_ns * 1e-9
        write_camchain(folder / f"camchain-{name}.yaml", self.rig)
        write_scene(folder / f"{name}_scene.npz", self.scene.boxes)


def simulate(config: SimulationConfig, motion: Motion | None = None) -> SimulatedRecording:
    """Simulate a stereo recording; the same input gives the same recording, bit for bit.

    `motion`, if given, replaces the random one, in a room as large as it needs.

    Raises
    ------
    InputError
        If the motion ends before the duration, or a camera leaves the part of the room that is
        clear of boxes, as one with too long a baseline does.
    """
    if motion is not None and motion.stop < config.duration - 1e-6:
        raise InputError(
            f"duration: {config.duration:g} s is longer than the motion, which is known for"
            f" {motion.stop:g} s"
        )
    seeds = np.random.SeedSequence(config.seed).spawn(4)
    scene_rng, motion_rng, *sensor_rngs = map(np.random.default_rng, seeds)
    room = config.room if motion is None else room_around(motion, config)
    scene = Scene.random(*room, config.boxes, scene_rng)
    motion = motion or Motion.random(config.motion, config.duration, motion_rng)
    truth = _true_poses(motion, config.duration)
    _require_clear_way(truth, config, room[1])
    times = frame_times(scene, motion, config)
    T_left_right = np.eye(4)
    T_left_right[0, 3] = config.baseline
    poses = motion.pose(times)
    cameras = (config, poses), (config.right, poses @ T_left_right)
    sides = [
        simulate_events(scene, camera, times, seen, rng)
        for (camera, seen), rng in zip(cameras, sensor_rngs, strict=True)
    ]
    with ThreadPoolExecutor(len(sides)) as pool:  # both cameras at once
        left, right = pool.map(Events.concatenate, sides)
    return _recording(config, scene, motion, truth, left, right)


def room_around(
    motion: Motion, config: SimulationConfig
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners (2, 3) of a room and of the part that the motion needs, metres."""
    way = motion.pose(np.linspace(0.0, config.duration, 200))[:, :3, 3]
    around = max(0.8, 1.1 * config.baseline)
    clear = np.stack([way.min(axis=0) - around, way.max(axis=0) + around])
    return clear + np.array([[-2.0], [2.0]]), clear


def _require_clear_way(
    truth: StampedPoses, config: SimulationConfig, clear: NDArray[np.float64]
) -> None:
    """Raise InputError if a camera leaves the part (2, 3) of the room where no boxes are."""
    for side, along in (("left", 0.0), ("right", config.baseline)):
        way = truth.positions + along * truth.T_world_cam[:, :3, 0]
        if (way < clear[0]).any() or (way > clear[1]).any():
            raise InputError(
                f"the {side} camera, with a baseline of {config.baseline:g} m, leaves the part of"
                " the room that is clear of boxes; choose a shorter baseline, or a motion in a"
                " larger room"
            )


def _true_poses(motion: Motion, duration: float) -> StampedPoses:
    """Return poses of the motion until `duration`, seconds."""
    t = np.linspace(0.0, duration, round(duration * GROUND_TRUTH_RATE) + 1)
    return StampedPoses(START_NS + np.rint(t * 1e9).astype(np.int64), motion.pose(t))


def _recording(
    config: SimulationConfig,
    scene: Scene,
    motion: Motion,
    truth: StampedPoses,
    left: Events,
    right: Events,
) -> SimulatedRecording:
    """Return the recording with t = 0 at the first event of either camera."""
    first = min((side.t[0] for side in (left, right) if len(side)), default=0.0)
    last = max((side.t[-1] for side in (left, right) if len(side)), default=first)
    return SimulatedRecording(
        path=Path(f"simulated_{config.motion}_{config.seed}"),
        rig=config.rig,
        start_ns=START_NS + round(first * 1e9),
        duration=round(float(last - first), 6),
        left=_later(left, first),
        right=_later(right, first),
        ground_truth=truth,
        motion=motion.later(first),
        scene=scene,
    )


def _later(events: Events, seconds: float) -> Events:
    """Return the same events with t = 0 moved later by `seconds`, in whole microseconds."""
    return replace(events, t=np.rint((events.t - seconds) * 1e6) / 1e6)
