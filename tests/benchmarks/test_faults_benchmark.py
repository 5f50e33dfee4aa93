"""The benchmark of faults, on a recording without one."""

from __future__ import annotations

from benchmarks.faults import main


def test_what_is_unharmed_is_measured_and_judged_good() -> None:
    results = main(["--faults", "unharmed", "--seeds", "1", "--duration", "0.5"])
    assert len(results) == 2
    assert {result.verdict for result in results} == {"good"}
