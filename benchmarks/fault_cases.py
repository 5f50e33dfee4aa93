"""Faults to put into a simulated recording, and what is to be said of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gpvo.recordings import Events
from gpvo.recordings.right_offset import with_right_offset
from gpvo.simulation import SimulatedRecording
from gpvo.trajectory import StampedPoses

Rng = np.random.Generator
Harm = Callable[[SimulatedRecording, float, Rng], SimulatedRecording]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Fault:
    """A fault.

    Attributes
    ----------
    name
        What is wrong.
    harm
        Puts it into a recording from a time on, seconds; the third argument draws at random.
    verdicts
        Words of the verdict that are right.
    said
        Part of the line that names the fault; empty where there is nothing to say.
    harmless
        The final error is at most 1.3 times that of the unharmed recording.
    """

    name: str
    harm: Harm
    verdicts: tuple[str, ...]
    said: str = ""
    harmless: bool = False


def _keep(events: Events, keep: Mask) -> Events:
    return events[keep]


def _both(recording: SimulatedRecording, change: Callable[[Events], Events]) -> SimulatedRecording:
    return replace(recording, left=change(recording.left), right=change(recording.right))


def merged(events: Events, more: Events) -> Events:
    """Join two streams in order of time."""
    both = Events.concatenate([events, more])
    return both[np.argsort(both.t, kind="stable")]


def _outside(events: Events, start: float, stop: float) -> Mask:
    return (events.t < start) | (events.t >= stop)


def unharmed(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
    """Leave the recording as it is."""
    return recording


def right_dies(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
    """Let the right camera send nothing any more."""
    return replace(recording, right=recording.right.between(-np.inf, t))


def right_late(seconds: float) -> Harm:
    """Stamp the right camera's events too late."""

    def harm(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
        late = replace(recording.right, t=recording.right.t + seconds)
        return replace(recording, right=late.between(-np.inf, recording.duration))

    return harm


def corrected(harm: Harm) -> Harm:
    """Correct the clocks afterwards, as --right-offset auto does."""

    def harmed(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
        late = harm(recording, t, rng)
        shifted = with_right_offset(late, "auto")
        right = Events.concatenate(batch.right for batch in shifted.event_batches())
        return replace(late, right=right)

    return harmed


def missing(seconds: float, share: float = 0.0) -> Harm:
    """Lose all events of both cameras for some time, or all but a share of them."""

    def harm(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
        def change(events: Events) -> Events:
            kept = rng.random(len(events)) < share
            return events[_outside(events, t, t + seconds) | kept]

        return _both(recording, change)

    return harm


def standstill(seconds: float, noise: float) -> Harm:
    """Stop the motion for some time, in which there is noise of so many Hz per pixel."""
    return partial(_stood_still, seconds=seconds, noise=noise)  # which workers can be sent


def _stood_still(
    recording: SimulatedRecording, t: float, rng: Rng, seconds: float, noise: float
) -> SimulatedRecording:
    def change(events: Events) -> Events:
        later = np.where(events.t < t, events.t, events.t + seconds)
        between = _noise(recording.rig.resolution, noise, t, seconds, rng)
        return merged(replace(events, t=later), between)

    still = _both(recording, change)
    truth = _held(recording.ground_truth, recording.stamp_ns(t), round(seconds * 1e9))
    return replace(still, duration=recording.duration + seconds, ground_truth=truth)


def at_first(harm: Harm) -> Harm:
    """Harm the beginning of a recording."""
    return lambda recording, t, rng: harm(recording, 1e-3, rng)


def _noise(
    resolution: tuple[int, int], rate: float, start: float, seconds: float, rng: Rng
) -> Events:
    width, height = resolution
    count = rng.poisson(rate * width * height * seconds)
    return Events(
        rng.integers(0, width, count).astype(np.uint16),
        rng.integers(0, height, count).astype(np.uint16),
        np.sort(start + seconds * rng.random(count)).round(6),
        rng.random(count) < 0.5,
    )


def _held(truth: StampedPoses, at_ns: int, pause_ns: int) -> StampedPoses:
    """Hold the pose at a stamp for some time."""
    pose, before = truth.interpolate(np.array([at_ns])).T_world_cam, truth.stamps_ns < at_ns
    pause = np.arange(at_ns, at_ns + pause_ns + 1, round(np.median(np.diff(truth.stamps_ns))))
    stamps = [truth.stamps_ns[before], pause, truth.stamps_ns[~before] + pause_ns + 1]
    held = np.repeat(pose, len(pause), axis=0)
    poses = [truth.T_world_cam[before], held, truth.T_world_cam[~before]]
    return StampedPoses(np.concatenate(stamps), np.concatenate(poses))


def hot_pixel(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
    """Let one pixel of the left camera fire a million times a second."""
    times = np.arange(0.0, recording.duration, 1e-6).round(6)
    width, height = recording.rig.resolution
    column, row = np.full(len(times), width // 3), np.full(len(times), height // 3)
    hot = Events(column.astype(np.uint16), row.astype(np.uint16), times, np.ones(len(times), bool))
    return replace(recording, left=merged(recording.left, hot))


def right_loses(share: float) -> Harm:
    """Lose a share of the right camera's events."""

    def harm(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
        kept = rng.random(len(recording.right)) >= share
        return replace(recording, right=recording.right[kept])

    return harm


def doubled(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
    """Write every event twice."""
    return _both(recording, lambda events: events[np.repeat(np.arange(len(events)), 2)])


def burst(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
    """Let every pixel of both cameras fire at random for 50 ms, at 400 Hz."""
    resolution = recording.rig.resolution
    return _both(recording, lambda events: merged(events, _noise(resolution, 400, t, 0.05, rng)))


def flashes(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
    """Let almost all pixels fire three times within 5 ms, ten times."""
    resolution = recording.rig.resolution
    times = t + 0.12 * np.arange(10)

    def change(events: Events) -> Events:
        for start in times.tolist():
            events = merged(events, _noise(resolution, 600, start, 0.005, rng))
        return events

    return _both(recording, change)


def packets_lost(share: float) -> Harm:
    """Lose a share of the packets of 1000 events."""

    def harm(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
        def change(events: Events) -> Events:
            packet = np.arange(len(events)) // 1000
            return events[(rng.random(packet[-1] + 1) >= share)[packet]]

        return _both(recording, change)

    return harm


def jitter(seconds: float) -> Harm:
    """Give the stamps random errors of this standard deviation, and sort them."""

    def harm(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
        def change(events: Events) -> Events:
            wrong = events.t + rng.normal(0.0, seconds, len(events))
            wrong = np.clip(wrong, 0.0, recording.duration).round(6)
            moved = replace(events, t=wrong)
            return moved[np.argsort(wrong, kind="stable")]

        return _both(recording, change)

    return harm


def swapped(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
    """Swap the cameras."""
    return replace(recording, left=recording.right, right=recording.left)


def lower(rows: int) -> Harm:
    """Shift the right camera's picture down by some rows."""

    def harm(recording: SimulatedRecording, t: float, rng: Rng) -> SimulatedRecording:
        right = recording.right
        inside = right[right.y < recording.rig.resolution[1] - rows]
        moved = replace(inside, y=(inside.y + rows).astype(np.uint16))
        return replace(recording, right=moved)

    return harm


MEASURED = ("good",)
HARMED = ("degraded", "failed")
EITHER = ("good", "degraded")

FAULTS = (
    Fault("unharmed", unharmed, MEASURED, harmless=True),
    Fault("right camera dies", right_dies, HARMED, "right camera"),
    Fault("right clock 50 ms late", right_late(0.05), HARMED, "late"),
    Fault("50 ms late, --right-offset auto", corrected(right_late(0.05)), MEASURED, harmless=True),
    Fault("2 s of events missing", missing(2.0), HARMED, "no events"),
    Fault("0.5 s of events missing", missing(0.5), HARMED, "no events", harmless=True),
    Fault("2 s standstill without events", standstill(2.0, 0.0), HARMED, "no events"),
    Fault("2 s standstill with noise", standstill(2.0, 0.2), MEASURED),
    Fault("2 s of rest at first", at_first(standstill(2.0, 0.2)), MEASURED, harmless=True),
    Fault("a pixel at 1 MHz", hot_pixel, MEASURED, "hot", harmless=True),
    Fault("right loses 30 %", right_loses(0.3), MEASURED, harmless=True),
    Fault("right loses 70 %", right_loses(0.7), HARMED, "right camera"),
    Fault("every event twice", doubled, MEASURED, "twice", harmless=True),
    Fault("burst of 50 ms", burst, EITHER, "burst"),
    Fault("ten flashes", flashes, ("good", "degraded", "failed"), ""),
    Fault("1 % of the events for 1 s", missing(1.0, 0.01), HARMED, ""),
    Fault("20 % of packets lost", packets_lost(0.2), EITHER, "", harmless=True),
    Fault("jitter of 2 ms", jitter(0.002), MEASURED, "", harmless=True),
    Fault("cameras swapped", swapped, ("failed",), "swapped"),
    Fault("right 4 rows lower", lower(4), HARMED, "rows"),
)
"""The rows of the table."""
