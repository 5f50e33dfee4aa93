"""`gpvo run`: estimate the motion of a recording, or of many."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from gpvo.commands.inputs import (
    Calibration,
    Config,
    Duration,
    GroundTruth,
    LeftTopic,
    Output,
    Plots,
    RightOffset,
    RightTopic,
    Seed,
    Start,
    check_start,
    checked_duration,
    configured,
    console,
    load_ground_truth,
)
from gpvo.commands.many import run_many
from gpvo.commands.provenance import (
    FILE,
    Request,
    absolute,
    calibration_of,
    read_provenance,
    write_provenance,
)
from gpvo.commands.result import (
    FILES,
    writing,
)
from gpvo.commands.run_and_write import DEAD_RECKONING, run_and_write
from gpvo.commands.watch import Save, Video, View, Watch
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.evaluation.report.result_folder import claim_folder, new_folder
from gpvo.recordings import open_recording
from gpvo.recordings.right_offset import with_right_offset
from gpvo.verdict import Verdict


def run(
    recordings: Annotated[
        list[Path] | None, typer.Argument(help="Stereo event recording, or many.")
    ] = None,
    calibration: Calibration = None,
    ground_truth: GroundTruth = None,
    output: Output = None,
    config: Config = None,
    start: Start = 0.0,
    duration: Duration = None,
    seed: Seed = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
    right_offset: RightOffset = "0",
    plots: Plots = "png",
    repeat: Annotated[
        Path | None, typer.Option(help="Result folder, to make its run again as it was.")
    ] = None,
    view: View = False,
    save: Save = None,
    video: Video = None,
    jobs: Annotated[int, typer.Option(min=1, help="Of many recordings, how many at once.")] = 1,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, to run them there.")
    ] = None,
) -> None:
    """Estimate the motion of a recording; write trajectory, metrics and plots.

    Many recordings: {} in --calibration and --ground-truth is a recording's name, and each has a
    folder in --output; the same command again runs those that are not finished.

    Exit status 2: bad input. 3: failed, most of the trajectory is dead reckoning, or the clocks are
    apart. 4: results cannot be written. 130 and 143: ended by Ctrl-C or SIGTERM, with the results
    so far.
    """
    watch = Watch(view, save, video)
    many = len(recordings or []) > 1 or scheduler is not None
    if many:
        _refuse_for_many({"--repeat": repeat, "--view": view, "--save": save, "--video": video})
    if repeat is not None:
        if recordings:
            raise InputError("--repeat: takes the recording of that run; give no other")
        request, configuration = read_provenance(repeat)
        folder = output or repeat.with_name(f"{repeat.name}_repeated")
    else:
        if not recordings:
            raise InputError("recording: give a stereo event recording, or --repeat DIR")
        configuration = configured(config, seed)
        common = start, checked_duration(duration), left_topic, right_topic, right_offset
        requests = [
            Request(
                str(recording.absolute()),
                absolute(calibration_of(recording, _of(calibration, recording))),
                absolute(_of(ground_truth, recording)),
                *common,
            )
            for recording in recordings
        ]
        if many:
            folder, workers = output or new_folder("many"), (jobs, scheduler)
            status = run_many(requests, configuration, folder, plots, workers, console)
            raise typer.Exit(status)
        request, folder = requests[0], output or new_folder(recordings[0].stem)
    judged = _run(request, configuration, folder, plots, watch)
    if judged.word == "failed":
        raise typer.Exit(DEAD_RECKONING)


def _of(pattern: Path | None, recording: Path) -> Path | None:
    """Return a recording's file, where {} is its name."""
    return None if pattern is None else Path(str(pattern).replace("{}", recording.stem))


def _refuse_for_many(given: Mapping[str, object]) -> None:
    """Raise InputError if an option is given that is for one recording."""
    for option, value in given.items():
        if value:
            raise InputError(
                f"{option}: is for one recording; leave it out, or run them one by one"
            )


def _run(
    request: Request, configuration: Configuration, folder: Path, plots: str, watch: Watch
) -> Verdict:
    """Open what was asked for, estimate, and write the results."""
    path, files = Path(request.recording), request.files
    calibration = files.get("calibration")
    opened = open_recording(path, calibration, request.left_topic, request.right_topic)
    opened = with_right_offset(opened, request.right_offset)
    duration = np.inf if request.duration is None else request.duration
    check_start(opened, request.start)
    truth, span = files.get("ground_truth"), (request.start, duration)
    poses = load_ground_truth(truth, opened, calibration, *span) if truth else None
    folder = claim_folder(folder, FILES)
    with writing(folder):
        write_provenance(folder, request, configuration)
    how = console, *span, watch, plots, str(truth)
    try:
        return run_and_write(opened, configuration, folder, poses, *how)
    except InputError:
        (folder / FILE).unlink(missing_ok=True)
        raise
