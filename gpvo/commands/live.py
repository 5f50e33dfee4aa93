"""`gpvo live`: estimate the motion of running cameras, or of a recording at its own pace."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from gpvo.cluster_report import ClusterReport
from gpvo.commands.inputs import (
    Calibration,
    Config,
    LeftTopic,
    Output,
    RightOffset,
    RightTopic,
    Seed,
    checked_duration,
    configured,
    console,
)
from gpvo.commands.interruption import end_at_ctrl_c
from gpvo.commands.live_trajectory import live_file
from gpvo.commands.progress import live_progress
from gpvo.commands.result import FILES, writing
from gpvo.commands.run_and_write import DEAD_RECKONING, write_results
from gpvo.commands.seen import Seen
from gpvo.commands.watch import Save, Video, View, Watch
from gpvo.errors import InputError
from gpvo.evaluation.report.result_folder import claim_folder, new_folder
from gpvo.evaluation.report.run_time import CostMeter
from gpvo.live import LiveOdometry
from gpvo.live.load import Level
from gpvo.live.recorder import Recorder
from gpvo.live.session import LiveSession
from gpvo.live.sources import SOURCES, RecordingPlayer, Source, is_camera, open_cameras
from gpvo.lost_stage import lost_stage
from gpvo.observer import observers
from gpvo.recordings import StereoRig, open_recording, read_calibration
from gpvo.recordings.right_offset import offset_of, offset_seconds
from gpvo.warm_up.whole import warm_up


def live(
    source: Annotated[str, typer.Argument(help=f"Recording to play, or {SOURCES}.")],
    calibration: Calibration = None,
    speed: Annotated[float, typer.Option(min=0.01, help="Of a recording: 1 is its own.")] = 1.0,
    output: Output = None,
    record: Annotated[Path | None, typer.Option(help="File to keep the events in.")] = None,
    config: Config = None,
    start: Annotated[float, typer.Option(min=0, help="Of a recording: seconds to skip.")] = 0.0,
    duration: Annotated[
        float | None,
        typer.Option(help="Seconds to run; default: until the source ends.", show_default=False),
    ] = None,
    seed: Seed = None,
    left_topic: LeftTopic = None,
    right_topic: RightTopic = None,
    right_offset: RightOffset = "0",
    view: View = False,
    save: Save = None,
    video: Video = None,
) -> None:
    """Estimate the motion while events come; Ctrl-C ends it and writes the results.

    Exit status 3: failed, most of the trajectory is dead reckoning, or the clocks are apart. 130
    and 143: ended by Ctrl-C or SIGTERM, with the results so far. 4: results or the recording could
    not be written.
    """
    configuration = configured(config, seed)
    span = start, checked_duration(duration) or np.inf
    topics = left_topic, right_topic
    rig, events, late = _opened(source, calibration, speed, span, topics, right_offset)
    folder = claim_folder(output or new_folder(_name(source)), FILES)
    recorder = Recorder(record, rig) if record else None
    with console.status("getting ready"):
        warm_up(configuration)
    meter = CostMeter()
    with ExitStack() as opened:
        odometry = LiveOdometry(rig, configuration, stage=meter.stage, right_offset=late)
        watch, seen = Watch(view, save, video), Seen()
        odometry.watch(observers(seen, opened.enter_context(watch.observer(meter.stages))))
        session = LiveSession(odometry, rig, events, recorder)
        advance = opened.enter_context(_shown(session, folder, span[1]))
        interruption = opened.enter_context(end_at_ctrl_c(events.close))
        if recorder is not None:
            opened.callback(recorder.close)
        session.run(advance)
        trajectory = odometry.close()
    if trajectory is None and interruption.happened:
        raise typer.Exit(interruption.status)
    if trajectory is None:
        lost = lost_stage(odometry.reports) if odometry.reports else "no events came"
        raise InputError(f"{source}: no landmark could be tracked: {lost}")
    with writing(folder):
        judged = write_results(
            folder, odometry.odometry, trajectory, None, meter, seen, console, read=session.faults
        )
    _say(session)
    if recorder is not None:
        recorder.check()
    if interruption.happened:
        raise typer.Exit(interruption.status)
    if judged.word == "failed":
        raise typer.Exit(DEAD_RECKONING)


@contextmanager
def _shown(
    session: LiveSession, folder: Path, duration: float
) -> Iterator[Callable[[ClusterReport], None]]:
    """Show every cluster and append to the trajectory's file; end after `duration` seconds."""
    live = session.live
    file = live_file(folder / "trajectory.tum", lambda: live.start_ns or 0)
    with live_progress(console, session) as show, file as append_final:
        live.watch(append_final)

        def advance(report: ClusterReport) -> None:
            show(report)
            if report.stop - live.reports[0].start >= duration:
                session.end()

        yield advance


def _opened(
    source: str,
    calibration: Path | None,
    speed: float,
    span: tuple[float, float],
    topics: tuple[str | None, str | None],
    offset: str,
) -> tuple[StereoRig, Source, float]:
    """Open cameras or a recording: the rig, the events, and how late the right stamps are."""
    if not is_camera(source):
        recording = open_recording(Path(source), calibration, *topics)
        late, (start, duration) = offset_of(recording, offset), span
        # The right camera's events of the last moment have later stamps.
        player = RecordingPlayer(recording, speed, start, duration + abs(late))
        return recording.rig, player, late
    if calibration is None:
        raise InputError(f"{source}: --calibration is needed for cameras")
    if offset == "auto":
        raise InputError(
            "--right-offset auto: needs a recording; keep one by --record, and give the seconds"
            " that gpvo info says of it"
        )
    late, rig = offset_seconds(offset), read_calibration(calibration)
    return rig, open_cameras(source, rig), late


def _name(source: str) -> str:
    return source.partition("://")[0] if is_camera(source) else Path(source).stem


def _say(session: LiveSession) -> None:
    """Print latency, and what was shed or repaired."""
    median, most, nearly_all = (f"{1e3 * each:.0f}" for each in session.latency.percentiles())
    console.print(
        f"latency after a cluster's last event: median {median} ms, 95 % {most} ms,"
        f" 99 % {nearly_all} ms"
    )
    load = session.load
    if load.worst != Level():
        console.print(
            f"the computer was busy: nothing was shed for {load.full_seconds:.1f} s of"
            f" {load.seconds:.1f} s, at worst {load.worst} used; left out:"
            f" {load.left_out:,} events between clusters,"
            f" {load.discarded:,} that had waited too long",
            style="yellow",
        )
    for kind, count in sorted(session.faults.items()):
        console.print(f"{count:,} {kind}", style="yellow")
