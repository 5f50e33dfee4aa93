"""The run's summary says what was left out and how long the camera was at rest, if it was."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from rich.console import Console

from gpvo import Odometry
from gpvo.commands.result import Result
from gpvo.events.noise_rate import WINDOW, passing_share, support_time
from gpvo.simulation import SimulationConfig, simulate
from gpvo.tracking import TrackingReport

NOISE = 4.0
"""Events per pixel and second."""
ROOM = SimulationConfig(seed=1, duration=0.5)


@cache
def run(noise_rate: float) -> Result:
    recording = simulate(ROOM.model_copy(update={"noise_rate": noise_rate}))
    odometry = Odometry(recording.rig)
    trajectory = odometry.run(recording)
    return Result(trajectory, odometry.reports, [], odometry.configuration, odometry.verdict())


def rows(result: Result) -> dict[str, str]:
    """Return the rows of the summary's table by name."""
    console = Console(width=200)
    with console.capture() as shown:
        console.print(result.table())
    cells = [line.split("│")[1:3] for line in shown.get().splitlines() if "│" in line]
    return {name.strip(): value.strip() for name, value in cells}


def test_a_clean_stream_in_motion_has_no_such_rows() -> None:
    result = run(0.0)
    assert not {"noise left out", "flashes left out", "at rest"} & set(rows(result))
    metrics = result.metrics()["run"]
    assert metrics["background_left_out_percent"] == metrics["hot_pixels_left_out_percent"] == 0
    assert metrics["flashes"] == metrics["flashes_s"] == metrics["at_rest_s"] == 0
    assert metrics["background_activity"] < 0.5


def test_noise_that_was_left_out_is_said_with_its_rate() -> None:
    result, clean = run(NOISE), run(0.0)
    metrics = result.metrics()["run"]
    last = [report.noise_rate for report in result.reports][-1]
    assert last == pytest.approx(NOISE, rel=0.25)
    pixels = ROOM.pixels * 2
    share = metrics["background_left_out_percent"] / 100
    assert 0.3 * NOISE * pixels < metrics["events"] * share / (1 - share) / ROOM.duration
    # All noise passes for the first 0.1 s, then the share that is let through.
    share_passing = passing_share(NOISE, support_time(NOISE))
    passed = NOISE * pixels * (WINDOW + 1.1 * share_passing * (ROOM.duration - WINDOW))
    assert metrics["events"] < clean.metrics()["run"]["events"] + passed
    row = rows(result)["noise left out"]
    assert row.startswith(f"{100 * share:.1f} % background activity (")
    assert f"{metrics['background_activity']:.2f} events per pixel and s" in row


def test_flashes_hot_pixels_and_rest_are_said() -> None:
    result = run(0.0)
    still = TrackingReport(0, 0, 9, 9, at_rest=True)
    reports = [replace(report, left_out=(0, 0), between=0) for report in result.reports]
    reports[1] = replace(reports[1], flash=0.05)
    reports[2] = replace(reports[2], flash=0.02, left_out=(0, sum(r.events for r in reports)))
    reports[3] = replace(reports[3], tracking=still, start=10.0, stop=12.5)
    changed = replace(result, reports=reports)
    found = rows(changed)
    assert found["flashes left out"] == "2, 0.070 s"
    assert found["at rest"] == "2.50 s"
    assert found["noise left out"].endswith(", 50.0 % of hot pixels")
    metrics = changed.metrics()["run"]
    assert (metrics["flashes"], metrics["at_rest_s"]) == (2, 2.5)
    assert metrics["hot_pixels_left_out_percent"] == 50
