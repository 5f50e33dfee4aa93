"""Options that would measure nothing, or for ever, are refused with what to give."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

from benchmarks import (
    departures,
    drift,
    faults,
    fuzz_recordings,
    honest_runs,
    live,
    mvsec,
    recordings,
    scaling,
    simulated,
)


@pytest.mark.parametrize(
    ("main", "arguments", "told"),
    [
        (live.main, "--speeds 1,0", "0: give a positive number"),
        (live.main, "--resolution 346", "346: give WIDTHxHEIGHT"),
        (scaling.main, "--resolutions 0x260", "0x260: give WIDTHxHEIGHT"),
        (scaling.main, "--seconds 0", "0: give a positive number"),
        (recordings.main, "--rate nan", "nan: give a positive number"),
        (recordings.main, "--bag-size x", "x: give a positive number"),
        (honest_runs.main, "--seeds 0", "0: give 1 or more"),
        (faults.main, "--seeds -1", "-1: give 1 or more"),
        (faults.main, "--duration inf", "inf: give a positive number"),
        (fuzz_recordings.main, "--count 0", "0: give 1 or more"),
        (mvsec.main, "--data . --jobs 0", "0: give 1 or more"),
        (simulated.main, "--seeds 0", "0: give 1 or more"),
        (simulated.main, "--duration 0", "0: give a positive number"),
        (simulated.main, "--first-seed -1", "-1: give 0 or more"),
        (drift.main, "--jobs 0", "0: give 1 or more"),
        (departures.main, "--seeds 0", "0: give 1 or more"),
    ],
)
def test_numbers_that_measure_nothing_are_refused(
    main: Callable[[], object],
    arguments: str,
    told: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["benchmark", *arguments.split()])
    with pytest.raises(SystemExit):
        main()
    assert told in capsys.readouterr().err
