"""The comparison of front ends, on a tiny recording and a few of them."""

from __future__ import annotations

import math

import pytest
from rich.console import Console

from benchmarks.front_end import (
    BY_NAME,
    DEFAULT,
    Quality,
    configuration_of,
    quality,
    recording_table,
    summary_table,
)
from benchmarks.known_motion import KnownRecording
from gpvo.simulation import SimulatedRecording

FRONT_ENDS = (DEFAULT, "binary")


@pytest.fixture(scope="module")
def results(recording: SimulatedRecording) -> dict[str, Quality]:
    known = KnownRecording.simulated("tiny", recording)
    return {name: quality(known, configuration_of(name)) for name in FRONT_ENDS}


def printed(table: object) -> str:
    console = Console(width=200)
    with console.capture() as capture:
        console.print(table)
    return capture.get()


def test_every_front_end_can_be_configured_and_differs_from_the_default() -> None:
    dumped = [configuration_of(name).model_dump_json() for name in BY_NAME]
    assert len(set(dumped)) == len(dumped)


def test_front_ends_are_measured(results: dict[str, Quality]) -> None:
    for found in results.values():
        assert found.true_inliers > 20
        assert found.precision > 0.9
        assert abs(found.slope - 1) < 0.05
        assert found.left < 0.5 and found.disparity < 0.5
        assert found.relative < 0.01 and found.final < 0.1
        assert found.cost > 0


def test_tables_show_them(results: dict[str, Quality]) -> None:
    lines = printed(recording_table("tiny", results)).splitlines()
    assert "tiny" in lines[0]
    assert sum(any(name in line for line in lines) for name in FRONT_ENDS) == len(FRONT_ENDS)
    row = next(line for line in lines if DEFAULT in line)
    assert f"{results[DEFAULT].relative:.2e}" in row


def test_the_default_is_once_the_default(results: dict[str, Quality]) -> None:
    lines = printed(summary_table([results, results])).splitlines()
    row = next(line for line in lines if DEFAULT in line and "│" in line)
    assert [cell.strip() for cell in row.split("│")[3:-1]] == ["1.00"] * 6
    row = next(line for line in lines if "binary" in line)
    ratio = results["binary"].relative / results[DEFAULT].relative
    assert row.split("│")[6].strip() == f"{ratio:.2f}"


def test_unknown_numbers_are_left_out(results: dict[str, Quality]) -> None:
    lost = Quality(*[math.nan] * 11)
    both = [results, {**results, "binary": lost}]
    row = next(line for line in printed(summary_table(both)).splitlines() if "binary" in line)
    ratio = results["binary"].left / results[DEFAULT].left
    assert row.split("│")[4].strip() == f"{ratio:.2f}"
