"""`gpvo info`: the contents and faults of a recording."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from gpvo.commands.inputs import Calibration as CalibrationFile
from gpvo.commands.inputs import LeftTopic, RightTopic, console
from gpvo.commands.progress import reading_progress
from gpvo.errors import InputError
from gpvo.evaluation.poses.load import load_poses
from gpvo.recordings import Events, Recording
from gpvo.recordings.calibration.find import (
    Calibration,
    MissingCalibrationError,
    calibrations_beside,
)
from gpvo.recordings.calibration.unknown import UNKNOWN_RIG
from gpvo.recordings.checks.row_rates import RowRates
from gpvo.recordings.open_recording import open_cameras
from gpvo.recordings.pairing import NO_CAMERA, OneCameraError
from gpvo.recordings.right_offset import LOOKED_AT

GAP_SECONDS = 0.05
"""Longest normal time between events, seconds; even a camera at rest has noise events."""

GROUND_TRUTH = (
    "*_gt.hdf5",
    "*_gt.bag",
    "*gt.txt",
    "*groundtruth*.txt",
    "mocap_data.txt",
    "pose.bag",
    "*odometry*/pose.bag",
)
"""Patterns of the names of ground truths beside the recording."""


def info(
    recording: Annotated[Path, typer.Argument(help="Stereo event recording.")],
    calibration: CalibrationFile = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
) -> None:
    """Print what a recording holds: sensor, events, calibration, ground truth, faults."""
    with _unsaid("gpvo.recordings"):
        opened, calibrated = open_for_info(recording, calibration, left_topic, right_topic)
        with reading_progress(console, opened.duration) as advance:
            summary = summarise(opened, calibrated, advance)
    for table in summary.tables():
        console.print(table)
    for warning in summary.warnings:
        console.print(f"warning: {warning}", style="yellow", highlight=False)


@contextmanager
def _unsaid(name: str) -> Iterator[None]:
    """Keep a logger's warnings back, which the summary has with their numbers."""
    logger = logging.getLogger(name)
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)


@dataclass
class CameraEvents:
    """Statistics of the events of one camera.

    Attributes
    ----------
    count
        Number of events.
    on
        Number of events of pixels that became brighter.
    first, last
        Seconds since the recording's start.
    reach
        Smallest sensor that holds all events, (width, height).
    gaps
        (start, duration) of the times without events, seconds.
    """

    count: int = 0
    on: int = 0
    first: float = np.nan
    last: float = np.nan
    reach: tuple[int, int] = (0, 0)
    gaps: list[tuple[float, float]] = field(default_factory=list)

    def add(self, events: Events) -> None:
        """Add events to the statistics."""
        if len(events) == 0:
            return
        before = events.t[0] if np.isnan(self.last) else self.last
        steps = np.diff(events.t, prepend=before)
        for index in np.flatnonzero(steps > GAP_SECONDS):
            self.gaps.append((float(events.t[index] - steps[index]), float(steps[index])))
        self.first = float(events.t[0]) if np.isnan(self.first) else self.first
        self.last = float(events.t[-1])
        self.count += len(events)
        self.on += int(events.polarity.sum())
        width, height = int(events.x.max()) + 1, int(events.y.max()) + 1
        self.reach = max(self.reach[0], width), max(self.reach[1], height)

    def row(self) -> list[str]:
        """Return the cells of the table: events, rate, share of ON, first, last, gaps."""
        span = max(self.last - self.first, 1e-9)
        longest = max((seconds for _, seconds in self.gaps), default=0.0)
        return [
            f"{self.count:,}",
            f"{self.count / span / 1e6:.3f} M/s",
            f"{self.on / max(self.count, 1):.0%}",
            f"{self.first:.6f} s",
            f"{self.last:.6f} s",
            f"{len(self.gaps)}, longest {longest:.3f} s" if self.gaps else "none",
        ]


@dataclass(frozen=True)
class Summary:
    """Contents and faults of a recording."""

    recording: Recording
    calibrated: bool
    left: CameraEvents
    right: CameraEvents
    ground_truth: list[str]
    warnings: list[str]

    def tables(self) -> list[Table]:
        """Return the tables of the recording and of its cameras."""
        about = Table(show_header=False, title=str(self.recording.path))
        for name, value in self._facts():
            about.add_row(name, value)
        cameras = Table("camera", "events", "rate", "ON", "first", "last", "gaps over 50 ms")
        for side in self.recording.sides:
            cameras.add_row(side, *(self.left if side == "left" else self.right).row())
        return [about, cameras]

    def _stated_sensor(self) -> str:
        """Format the size that the file states, or the smallest that holds all events."""
        streams = getattr(self.recording, "streams", {})
        stated = next(iter(streams.values())).resolution if streams else None
        width, height = stated or np.maximum(self.left.reach, self.right.reach)
        return f"{width} x {height}" if stated else f"at least {width} x {height}"

    def _facts(self) -> list[tuple[str, str]]:
        recording, rig = self.recording, self.recording.rig
        start = datetime.fromtimestamp(recording.start_ns // 10**9, UTC)
        facts = [
            ("format", recording.format_name),
            ("duration", f"{recording.duration:.6f} s"),
            ("start", f"{recording.start_ns / 1e9:.6f} s ({start:%Y-%m-%d %H:%M:%S} UTC)"),
        ]
        if self.calibrated:
            width, height = rig.left.resolution
            facts += [
                ("sensor", f"{width} x {height}"),
                ("calibration", f"{rig.left.distortion_model}, f {rig.focal_length:.2f} px"),
                ("baseline", f"{rig.baseline:.6f} m"),
            ]
        else:
            unknown = without_calibration(recording.path)
            facts += [("sensor", self._stated_sensor()), ("calibration", unknown)]
        missing = "none found" if self.calibrated else "not looked for without a calibration"
        return [*facts, ("ground truth", "\n".join(self.ground_truth) or missing)]


def without_calibration(recording: Path) -> str:
    """Say why a recording was opened without a calibration."""
    beside = [file.name for file in calibrations_beside(recording)]
    return f"several: {', '.join(beside)}; give one" if len(beside) > 1 else "none found"


def open_for_info(
    path: Path, calibration: Calibration, left: str | None, right: str | None
) -> tuple[Recording, bool]:
    """Open a recording, also of one camera or without calibration; return whether it has one."""
    try:
        return open_cameras(path, calibration, left, right), True
    except MissingCalibrationError:
        return open_for_info(path, UNKNOWN_RIG, left, right)[0], False
    except OneCameraError:
        rig = calibration or UNKNOWN_RIG  # one beside it may be of another camera
        return open_cameras(path, rig, left, NO_CAMERA), calibration not in (None, UNKNOWN_RIG)


def summarise(
    recording: Recording,
    calibrated: bool = True,
    advance: Callable[[float], object] = lambda _: None,
) -> Summary:
    """Read a whole recording once and summarise it.

    Parameters
    ----------
    advance
        Called with the seconds read so far.
    """
    left, right, rates = CameraEvents(), CameraEvents(), RowRates(recording.rig, LOOKED_AT)
    for batch in recording.event_batches():
        if batch.stop <= LOOKED_AT:
            rates.add(batch)
        left.add(batch.left)
        right.add(batch.right)
        advance(batch.stop)
    warnings = [*recording.notes, *recording.fault_lines()]
    if len(recording.sides) == 1:
        warnings.append(f"{recording.path}: holds one camera; gpvo needs two to run")
    offset = rates.offset()
    if offset is not None and offset.is_apart:
        warnings.append(
            f"the right camera's stamps seem to be {offset} late: its events follow the left one's"
            " by that time; synchronise the clocks, or run with --right-offset auto"
        )
    truth = ground_truths(recording) if calibrated else []
    return Summary(recording, calibrated, left, right, truth, warnings)


def ground_truths(recording: Recording) -> list[str]:
    """Describe the ground truths beside a recording, each with its span or its fault."""
    path = recording.path.absolute()
    folder = path if path.is_dir() else path.parent
    lines = []
    for file in sorted({file for pattern in GROUND_TRUTH for file in folder.glob(pattern)}):
        try:
            poses = load_poses(file, recording.rig, [path])
        except InputError as error:
            lines.append(str(error))
            continue
        start, stop = (poses.stamps_ns[[0, -1]] - recording.start_ns) / 1e9
        lines.append(f"{file.name}: {len(poses)} poses from {start:.3f} s to {stop:.3f} s")
    return lines
