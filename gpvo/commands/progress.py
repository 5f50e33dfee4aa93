"""Progress of a run, or of reading a recording, on the terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from gpvo.odometry import ClusterReport


class RunProgress:
    """Progress bar over recording time with events per second, tracklets and real-time factor."""

    def __init__(self, console: Console, start: float, stop: float) -> None:
        self._start, self._stop = start, stop
        self._events = 0
        self._bar = Progress(
            TextColumn("{task.fields[seconds]:.2f} of {task.total:.2f} s"),
            BarColumn(),
            TextColumn("{task.fields[speed]}"),
            console=console,
        )

    def __enter__(self) -> RunProgress:
        self._bar.start()
        self._began = time.perf_counter()
        self._task = self._bar.add_task(
            "", total=self._stop - self._start, seconds=0.0, speed="compiling"
        )
        return self

    def advance(self, report: ClusterReport) -> None:
        """Advance the bar by one finished cluster."""
        self._events += report.events
        spent = time.perf_counter() - self._began
        done = report.stop - self._start
        speed = (
            f"{self._events / spent / 1e6:.2f} M events/s, {report.inliers} of {report.tracklets}"
            f" tracklets, {done / spent:.2f} x real time"
        )
        self._bar.update(self._task, completed=done, seconds=done, speed=speed)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._bar.stop()


@contextmanager
def reading_progress(console: Console, duration: float) -> Iterator[Callable[[float], None]]:
    """Show a progress bar over recording time that vanishes at the end."""
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("reading", total=duration)
        yield lambda seconds: bar.update(task, completed=seconds)
