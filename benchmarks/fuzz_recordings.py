"""Damage small files of every format at random, many times: `python -m benchmarks.fuzz_recordings`.

It prints, by format and kind of damage, how often reading was complete (`whole`), reported its
losses (`told`), lost something that the format cannot show (`untold`: a changed pixel without a
checksum), or raised one error, and the longest time for one file. Any other exception ends the run.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import yaml
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "recordings"))

from damage import DAMAGES, cut, outcome, samples
from reading import read_recording
from recording_files import camchain

from benchmarks.options import at_least_one
from gpvo.recordings import open_recording

OUTCOMES = ("whole", "told", "untold", "error")


def main() -> None:
    """Run the fuzz test for every format."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--count", type=at_least_one, default=300, help="files per format and damage"
    )
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    logging.getLogger("gpvo.recordings").setLevel(logging.CRITICAL)
    table = Table("format", "damage", *OUTCOMES, "longest s")
    with tempfile.TemporaryDirectory() as folder:
        for row in fuzz(Path(folder), options.count, options.seed):
            table.add_row(*row)
    Console().print(table)


def fuzz(folder: Path, count: int, seed: int) -> list[list[str]]:
    """Return one row of counts for each format and damage."""
    calibration = folder / "calibration.yaml"
    calibration.write_text(yaml.safe_dump(camchain()))
    rows = []
    for name, sample in samples(folder, calibration).items():
        whole = sample.damaged.read_bytes()
        expected = read_recording(open_recording(sample.path, calibration))
        for damage in DAMAGES:
            rng = np.random.default_rng(seed)
            outcomes: Counter[str] = Counter()
            longest = 0.0
            for _ in range(count):
                sample.damaged.write_bytes(damage(whole, rng))
                began = time.perf_counter()
                outcomes[outcome(sample, expected, damage is cut)] += 1
                longest = max(longest, time.perf_counter() - began)
            counts = [str(outcomes[kind]) for kind in OUTCOMES]
            rows.append([name, damage.__name__, *counts, f"{longest:.2f}"])
        sample.damaged.write_bytes(whole)
    return rows


if __name__ == "__main__":
    main()
