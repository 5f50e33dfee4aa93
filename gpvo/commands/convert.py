"""`gpvo convert`: write a recording in another format, or a result as MCAP."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gpvo.commands.info import open_for_info, without_calibration
from gpvo.commands.inputs import Calibration, LeftTopic, RightTopic, console
from gpvo.commands.progress import reading_progress
from gpvo.errors import InputError
from gpvo.mapping import LandmarkMap
from gpvo.recordings.writing.convert import Kind, camchain_path, convert, kind_of
from gpvo.recordings.writing.result_mcap import write_result_mcap
from gpvo.trajectory import Trajectory

RESULT = "trajectory.npz"


def convert_recording(
    recording: Annotated[Path, typer.Argument(help="Stereo event recording, or result folder.")],
    output: Annotated[Path, typer.Argument(help="File; folder for DSEC, raw, text.")],
    to: Annotated[
        Kind | None,
        typer.Option(help="Format, if the ending of OUTPUT does not determine it."),
    ] = None,
    calibration: Calibration = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
) -> None:
    """Write a recording in another format: the same events, and the calibration beside them.

    Of a result folder, write poses, path and landmarks as MCAP for Foxglove and ROS 2.
    """
    if (recording / RESULT).is_file():
        _convert_result(recording, output)
        return
    kind = to or kind_of(output)
    opened, calibrated = open_for_info(recording, calibration, left_topic, right_topic)
    with reading_progress(console, opened.duration) as advance:
        counts = convert(opened, output, kind, advance)
    place = f"in {camchain_path(output, kind)}" if calibrated else without_calibration(opened.path)
    sides = opened.sides if len(counts) > 1 else ("",)
    numbers = (f"{count:,} {side}".strip() for count, side in zip(counts, sides, strict=True))
    console.print(
        f"{output} ({kind}): {' and '.join(numbers)} events; calibration {place}",
        soft_wrap=True,
        highlight=False,
    )


def _convert_result(folder: Path, output: Path) -> None:
    if output.suffix != ".mcap":
        raise InputError(f"{output}: a result is written as MCAP; name a file that ends with .mcap")
    landmarks = folder / "map.npz"
    count = write_result_mcap(
        output,
        Trajectory.load(folder / RESULT),
        LandmarkMap.load(landmarks) if landmarks.is_file() else None,
    )
    console.print(f"{output}: {count:,} messages", soft_wrap=True, highlight=False)
