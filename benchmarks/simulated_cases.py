"""The fixed suite of simulated recordings, each with a difficulty of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.fault_cases import Harm, burst, hot_pixel, standstill, unharmed
from benchmarks.moving_things import passes_by
from benchmarks.sensor_faults import flicker, half_dead, hot_pixels
from gpvo.evaluation.poses.load import load_poses
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate
from gpvo.simulation.motion import Motion
from gpvo.trajectory import StampedPoses

REFERENCE = Path(__file__).resolve().parents[2] / "shared" / "reference"
"""Folder beside the repository with real ground truth; it may be missing."""

FLIGHTS = {
    "real_flight1": ("mvsec_indoor_flying1", 12.0),
    "real_flight3": ("mvsec_indoor_flying3", 14.0),
}
"""Folder of the ground truth, and start of the case in seconds."""

FLIGHT_STEP = 0.1
"""Seconds between the poses of a real flight that the spline passes through."""

AHEAD = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""T_world_first of a level first camera, in a world with z up."""


@dataclass(frozen=True)
class Case:
    """A kind of recording; the run's seed replaces that of the config.

    `harm` is done to it, half-way if it has a time.
    """

    name: str
    config: SimulationConfig
    flight: StampedPoses | None = None
    harm: Harm = unharmed

    def recording(self, seed: int) -> SimulatedRecording:
        """Simulate the recording of one seed; a real flight stays, room and sensor noise change."""
        config = self.config.model_copy(update={"seed": seed})
        motion = None if self.flight is None else Motion.through(self.flight)
        whole = simulate(config, motion=motion)
        return self.harm(whole, 0.5 * config.duration, np.random.default_rng(seed))

    def shorter(self, duration: float) -> Case:
        """Return the case with at most `duration` seconds."""
        shorter = min(duration, self.config.duration)
        return replace(self, config=self.config.model_copy(update={"duration": shorter}))


def _case(name: str, harm: Harm = unharmed, **changes: object) -> Case:
    return Case(name, SimulationConfig.model_validate(changes), harm=harm)


CASES = (
    _case("slow"),
    _case("fast", motion="fast"),
    _case("rotation", motion="rotation"),
    _case("back_and_forth", motion="back_and_forth"),
    # Twice the threshold is half the contrast: events depend on their ratio alone.
    _case("low_texture", threshold=0.5, boxes=0),
    _case("high_noise", noise_rate=5.0),
    _case(
        "low_light", threshold=0.4, threshold_sigma=0.08, noise_rate=2.0, refractory_period=0.005
    ),
    _case("corridor", motion="corridor", duration=6.0),
    # The same field of view on sensors of other sizes.
    _case("240x180", resolution=(240, 180), focal_length=157.0),
    _case("640x480", resolution=(640, 480), focal_length=418.0, duration=2.0),
    _case("1280x720", resolution=(1280, 720), focal_length=836.0, duration=1.0),
    _case(
        "driving",
        motion="driving",
        duration=2.0,
        resolution=(640, 480),
        focal_length=418.0,
        baseline=0.5,
        boxes=25,
    ),
    # As a hall of 30 m with the usual baseline: disparities of a pixel or two.
    _case("far", baseline=0.02),
    _case("hot_pixel", hot_pixel),
    _case("hot_pixels", partial(hot_pixels, number=40, rate=20e3)),
    _case("flicker", partial(flicker, frequency=100.0, disparity=8)),
    _case("burst", burst),
    _case("half_dead", half_dead),
    # As the two cameras of a pair are biased: one has a third less events.
    _case("thresholds_differ", threshold=0.22, right_threshold=0.29),
    _case("passes_by", partial(passes_by, width=0.26)),
    # A camera at rest has noise. Without any, events are missing: see `benchmarks.faults`.
    _case("5_s_still", standstill(5.0, 0.1), noise_rate=0.1),
)


def all_cases(reference: Path = REFERENCE) -> tuple[Case, ...]:
    """Return the suite, with real flights if their ground truth is present."""
    config = SimulationConfig()
    flights = (
        Case(name, config, real_flight(reference / folder, start, config.duration))
        for name, (folder, start) in FLIGHTS.items()
        if (reference / folder).is_dir()
    )
    return (*CASES, *flights)


def real_flight(folder: Path, start: float, duration: float) -> StampedPoses:
    """Read `duration` seconds of a real flight, from a level first camera at the world's origin."""
    truth = load_poses(folder / "stamped_groundtruth.txt")
    seconds = np.arange(start, start + duration + 2.5 * FLIGHT_STEP, FLIGHT_STEP)
    piece = truth.interpolate(truth.stamps_ns[0] + np.round(seconds * 1e9).astype(np.int64))
    return piece.in_world(AHEAD @ np.linalg.inv(piece.T_world_cam[0]))
