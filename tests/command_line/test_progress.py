"""What a run says while it goes on."""

from __future__ import annotations

from io import StringIO
from types import SimpleNamespace

from rich.console import Console

from gpvo.commands.progress import run_progress


def test_compiling_is_no_part_of_the_speed() -> None:
    """The first run of a demo said 0.00 M events/s and 0.01 x real time to its end."""
    output, clock = StringIO(), iter([10.0, 10.5])
    with run_progress(Console(file=output, width=100), 0.0, 2.0, lambda: next(clock)) as advance:
        advance(SimpleNamespace(stop=1.0, events=3_000_000, inliers=8, tracklets=9))
    assert output.getvalue().startswith("1.00 of 2.00 s: 6.00 M events/s, 8 of 9 tracklets, 2.00 x")
