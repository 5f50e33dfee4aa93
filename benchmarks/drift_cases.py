"""Long recordings, in which what is lost little by little adds up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.simulated_cases import AHEAD, FLIGHTS, REFERENCE, Case, real_flight
from gpvo.simulation import SimulationConfig
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import rigid_transforms

Array = NDArray[np.float64]

FLIGHT_START = 6.0
"""Where the long part of a real flight begins, seconds: the camera is in the air."""

FLIGHT_DURATION = 18.0
HOVER_DURATION = 20.0
HOVER_STEP = 0.4
"""Seconds between the random poses of a camera that hovers."""

HOVER_SIGMA = 0.01
"""How far it hovers from where it should be, standard deviation, metres and radians."""

ROUND = 10.0
"""Seconds of a round of the loop."""

ROUNDS = 3
RADIUS = 0.9
"""Radius of the loop, metres."""

CORRIDOR_DURATION = 14.0
CORRIDOR_LENGTH = 2.0
STEP = 0.25
"""Seconds between the poses that the splines of loop and corridor pass through."""

LEVEL = Rotation.from_matrix(AHEAD[:3, :3])
"""R_world_cam of a level camera that looks along x of the world."""


def long_cases(reference: Path = REFERENCE) -> tuple[Case, ...]:
    """Return the long recordings, with real flights if their ground truth is present.

    Motions are the same for every seed, except back_and_forth's; rooms and sensors' noise differ.
    """
    flights = (
        _case(name, real_flight(reference / folder, FLIGHT_START, FLIGHT_DURATION), FLIGHT_DURATION)
        for name, (folder, _) in FLIGHTS.items()
        if (reference / folder).is_dir()
    )
    to_and_fro = SimulationConfig(motion="back_and_forth", duration=20.0)
    return (
        *flights,
        _case("hover", hover(), HOVER_DURATION),
        Case("back_and_forth", to_and_fro),
        _case("loop", loop(), ROUNDS * ROUND, boxes=8),
        _case("corridor", there_and_back(), CORRIDOR_DURATION),
    )


def _case(name: str, way: StampedPoses, duration: float, boxes: int = 5) -> Case:
    return Case(name, SimulationConfig(duration=duration, boxes=boxes), way)


def hover() -> StampedPoses:
    """Return the poses of a camera that stays where it is, as well as it can."""
    t = _times(HOVER_DURATION, HOVER_STEP)
    random = np.random.default_rng(3).normal(0.0, HOVER_SIGMA, (len(t), 6))
    return _poses(t, random[:, 3:], LEVEL * Rotation.from_rotvec(random[:, :3]))


def loop() -> StampedPoses:
    """Return the poses on a circle that is driven several times, looking along the tangent."""
    t = _times(ROUNDS * ROUND, STEP)
    angle = 2.0 * np.pi * t / ROUND
    ahead, left = RADIUS * np.sin(angle), RADIUS * (1.0 - np.cos(angle))
    positions = np.stack([ahead, left, 0.1 * np.sin(2.0 * angle)], axis=1)
    heading = Rotation.from_rotvec(np.outer(angle, [0.0, 0.0, 1.0]))
    return _poses(t, positions, heading * LEVEL * sway(t, 0.0))


def there_and_back() -> StampedPoses:
    """Return the poses of a camera that goes ahead and backs up again, looking ahead all along."""
    t = _times(CORRIDOR_DURATION, STEP)
    ahead = 0.5 * CORRIDOR_LENGTH * (1.0 - np.cos(2.0 * np.pi * t / CORRIDOR_DURATION))
    positions = np.stack([ahead, 0.1 * np.sin(t), 0.05 * np.sin(1.3 * t)], axis=1)
    return _poses(t, positions, LEVEL * sway(t, 0.08))


def sway(t: Array, yaw: float) -> Rotation:
    """Return small turns of the camera at times t (N,): pitch, yaw of an amplitude, and roll."""
    turns = [0.05 * np.sin(1.1 * t), yaw * np.sin(0.7 * t), 0.04 * np.sin(0.8 * t)]
    return Rotation.from_rotvec(np.stack(turns, axis=1))


def _times(duration: float, step: float) -> Array:
    """Return the times of a spline's poses, which end after the recording."""
    return np.arange(0.0, duration + 3.0 * step, step)


def _poses(t: Array, positions: Array, rotations: Rotation) -> StampedPoses:
    stamps_ns = np.rint(1e9 * t).astype(np.int64)
    return StampedPoses(stamps_ns, rigid_transforms(rotations.as_matrix(), positions))
