"""Compare with the paper's GPCT and ESVO, and given trajectories, on MVSEC's indoor flights.

python -m benchmarks.mvsec --data DIR [--sequences indoor_flying1 indoor_flying3]
    [--trajectories DIR] [--output DIR]
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from benchmarks.data_folder import find_file
from benchmarks.dataset import DatasetSequence, Outcome, arguments, exit_with, run_benchmark
from benchmarks.published import PAPER_ROWS
from gpvo.errors import InputError
from gpvo.evaluation.protocol import Protocol

CALIBRATION = "camchain-imucam-indoor_flying.yaml"

SPANS_NS: dict[str, tuple[int, int]] = {
    "indoor_flying1": (1_504_645_187_579_542_725, 1_504_645_213_410_580_373),
    "indoor_flying3": (1_504_645_453_280_441_489, 1_504_645_478_231_352_071),
}
"""First and last stamp of the flights without take-off and landing, nanoseconds.

They are those of the trajectories that ESVO2's authors published for their comparison with ESVO.
The paper gives no range for ESVO; its percentages refer to shorter paths, of 8.4 m and 6.0 m.
"""


def find_sequence(data: Path, name: str) -> DatasetSequence:
    """Find the files of a sequence in the user's folder.

    Raises
    ------
    InputError
        If the sequence is unknown or a file is missing; the message says where to put it.
    """
    if name not in SPANS_NS:
        raise InputError(f"--sequences {name}: known are {', '.join(SPANS_NS)}")
    advice = (
        f"put MVSEC's {name}_data.hdf5, {name}_gt.hdf5 and {CALIBRATION} (of"
        " indoor_flying_calib.zip) anywhere below the folder; they are at"
        " daniilidis-group.github.io/mvsec/download"
    )
    return DatasetSequence(
        name,
        find_file(data, [f"{name}_data.hdf5"], advice),
        find_file(data, [CALIBRATION], advice),
        find_file(data, [f"{name}_gt.hdf5"], advice),
        SPANS_NS[name],
        PAPER_ROWS[name],
    )


def main(
    arguments_given: Sequence[str] | None = None, console: Console | None = None
) -> list[Outcome]:
    """Parse the options and run the benchmark."""
    description = (__doc__ or "").partition("\n")[0]
    options = arguments(description, list(SPANS_NS)).parse_args(arguments_given)
    sequences = [find_sequence(options.data, name) for name in options.sequences]
    return run_benchmark(options, sequences, Protocol(), console or Console())


if __name__ == "__main__":
    exit_with(main)
