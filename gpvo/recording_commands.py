"""What `gpvo info` and `gpvo convert` do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from gpvo.info import open_for_info, summarise
from gpvo.recordings.writing.convert import camchain_path, convert, kind_of


def info_command(
    path: Path, calibration: Path | None, left: str | None, right: str | None, console: Console
) -> None:
    """Read a recording once and print what was found."""
    recording, calibrated = open_for_info(path, calibration, left, right)
    with progress(console, recording.duration) as advance:
        summary = summarise(recording, calibrated, advance)
    for table in summary.tables():
        console.print(table)
    for warning in summary.warnings:
        console.print(f"warning: {warning}", style="yellow", markup=False, highlight=False)


def convert_command(
    path: Path,
    output: Path,
    kind: str | None,
    calibration: Path | None,
    left: str | None,
    right: str | None,
    console: Console,
) -> None:
    """Write a recording in another format and print how many events it has."""
    kind = kind or kind_of(output)
    recording, calibrated = open_for_info(path, calibration, left, right)
    with progress(console, recording.duration) as advance:
        counts = convert(recording, output, kind, advance)
    place = f"in {camchain_path(output, kind)}" if calibrated else "none found"
    console.print(
        f"{output} ({kind}): {counts[0]:,} left and {counts[1]:,} right events;"
        f" calibration {place}",
        soft_wrap=True,
        highlight=False,
    )


@contextmanager
def progress(console: Console, duration: float) -> Iterator[Callable[[float], None]]:
    """A bar of recording time that vanishes at the end."""
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("reading", total=duration)
        yield lambda seconds: bar.update(task, completed=seconds)
