"""Progress of a run, or of reading a recording, on the terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from gpvo.cluster_report import ClusterReport
from gpvo.live.session import LiveSession

LINES = 20
"""Number of lines of a run's progress where there is no terminal, but a pipe or a file."""


@contextmanager
def run_progress(
    console: Console, start: float, stop: float, clock: Callable[[], float]
) -> Iterator[Callable[[ClusterReport], None]]:
    """Show recording time, events per second, tracklets and real-time factor, a cluster a call.

    `clock` returns seconds; it should stand still while kernels are compiled.
    """
    columns = (
        TextColumn("{task.fields[seconds]:.2f} of {task.total:.2f} s"),
        BarColumn(),
        TextColumn("{task.fields[speed]}"),
    )
    events, began, said = 0, clock(), start
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=stop - start, seconds=0.0, speed="")

        def advance(report: ClusterReport) -> None:
            nonlocal events, said
            events += report.events
            spent = max(clock() - began, 1e-3)
            done = report.stop - start
            speed = (
                f"{events / spent / 1e6:.2f} M events/s, {report.inliers} of {report.tracklets}"
                f" tracklets, {done / spent:.2f} x real time"
            )
            bar.update(task, completed=done, seconds=done, speed=speed)
            if not console.is_terminal and report.stop >= said + (stop - start) / LINES:
                said = report.stop
                console.print(f"{done:.2f} of {stop - start:.2f} s: {speed}", highlight=False)

        yield advance


@contextmanager
def live_progress(
    console: Console, session: LiveSession
) -> Iterator[Callable[[ClusterReport], None]]:
    """Show time, real-time factor, inliers, latency and what is shed, a cluster a call."""
    began = time.perf_counter()
    columns = TextColumn("{task.fields[seconds]:.2f} s"), TextColumn("{task.fields[state]}")
    with Progress(*columns, console=console) as line:
        task = line.add_task("", total=None, seconds=0.0, state="")

        def advance(report: ClusterReport) -> None:
            load, spent = session.load, time.perf_counter() - began
            latency = session.latency.seconds[-1:] or [0.0]
            state = (
                f"{report.stop / spent:.2f} x real time, {report.inliers} of {report.tracklets}"
                f" tracklets, latency {1e3 * latency[0]:.0f} ms, {load.level}"
            )
            line.update(task, seconds=report.stop, state=state)

        yield advance


@contextmanager
def reading_progress(console: Console, duration: float) -> Iterator[Callable[[float], None]]:
    """Show a progress bar over recording time that vanishes at the end."""
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("reading", total=duration)
        yield lambda seconds: bar.update(task, completed=seconds)
