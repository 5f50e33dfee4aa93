"""Speed and memory of the readers: `python -m benchmarks.recordings`.

Noise is written in every format, and read to the end by `event_batches()` and by other libraries in
the same run. Times are CPU seconds of this process, the best of three, so that other load on the
machine has little influence. The ratios are more reliable than the times.

`--bag-size 5` writes a ROS 1 bag of 5 GB and prints the peak resident memory of a new process that
reads it.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.dataset import exit_with
from benchmarks.options import positive
from gpvo.recordings import open_recording
from gpvo.recordings.calibration.unknown import UNKNOWN_RIG
from gpvo.recordings.streams import EventBlock
from gpvo.recordings.writing.convert import WRITERS

SIZE = (346, 260)
START_NS = 1_500_000_000_000_000_000
BATCH_NS = 100_000_000
NAMES = {
    "rosbag1": "a.bag",
    "mcap": "a.mcap",
    "mvsec": "packed.hdf5",
    "dsec": "dsec",
    "aedat4": "a.aedat4",
}
DESERIALISED_SECONDS = 1.0
"""Part of the recording that rosbags deserialises, seconds; all of it would take minutes."""


def batches_of_noise(
    seconds: float, rate: float, seed: int = 0
) -> Iterator[tuple[EventBlock, EventBlock]]:
    """Yield batches of random events of both cameras, `rate` events per second and camera."""
    rng = np.random.default_rng(seed)
    count = int(rate * BATCH_NS / 1e9)
    for number in range(round(seconds * 1e9 / BATCH_NS)):
        yield tuple(_noise(rng, count, START_NS + number * BATCH_NS) for _ in range(2))  # type: ignore[misc]


def _noise(rng: np.random.Generator, count: int, start_ns: int) -> EventBlock:
    t_ns = start_ns + 1000 * np.sort(rng.integers(0, BATCH_NS // 1000, count))
    x, y = (rng.integers(0, size, count).astype(np.uint16) for size in SIZE)
    return EventBlock(x, y, t_ns, rng.integers(0, 2, count).astype(bool))


def write(kind: str, path: Path, seconds: float, rate: float) -> None:
    """Write noise in a format."""
    with WRITERS[kind](path, (SIZE, SIZE), START_NS) as writer:
        for left, right in batches_of_noise(seconds, rate):
            writer.append(left, right)


def write_plain_mvsec(path: Path, packed: Path) -> None:
    """Write MVSEC without compression, like its own files; copies such as ours often use gzip."""
    with h5py.File(packed) as source, h5py.File(path, "w") as file:
        for name in (f"davis/{side}/events" for side in ("left", "right")):
            file.create_dataset(name, data=source[name][:])


def ours(path: Path) -> int:
    """Read all batches and return the number of events."""
    recording = open_recording(path, UNKNOWN_RIG)
    return sum(len(batch.left) + len(batch.right) for batch in recording.event_batches())


def rosbags_objects(path: Path) -> int:
    """Deserialise the first second with rosbags and return the number of events."""
    from rosbags.highlevel import AnyReader

    stop = START_NS + int(DESERIALISED_SECONDS * 1e9)
    with AnyReader([path]) as reader:
        return sum(
            len(reader.deserialize(raw, connection.msgtype).events)
            for connection, _, raw in reader.messages(stop=stop)
        )


def h5py_columns(path: Path) -> int:
    """Read with h5py alone, without any check, and return the number of events."""
    with h5py.File(path) as file:
        tables = [file[f"davis/{side}/events"] for side in ("left", "right")]
        return sum(table[:, column].size for table in tables for column in range(4)) // 4


def evlib_both(left: Path, right: Path) -> int:
    """Read with evlib, one camera at a time, and return the number of events."""
    import evlib

    return sum(evlib.load_events(str(path)).collect().height for path in (left, right))


def dv_processing(path: Path) -> int:
    """Read with dv-processing, batches as numpy arrays, and return the number of events."""
    import dv_processing as dv

    recording = dv.io.StereoCameraRecording(str(path), "left", "right")
    count = 0
    for reader in (recording.getLeftReader(), recording.getRightReader()):
        while (batch := reader.getNextEventBatch()) is not None:
            count += len(batch.numpy())
    return count


def speed(read: Callable[[], int]) -> tuple[float, float] | None:
    """Measure million events per CPU second and second, best of three; None if not installed."""
    best = [0.0, 0.0]
    for _ in range(3):
        cpu, wall = time.process_time(), time.perf_counter()
        try:
            count = read()
        except ImportError:
            return None
        spent = time.process_time() - cpu, time.perf_counter() - wall
        best = [max(old, count / new / 1e6) for old, new in zip(best, spent, strict=True)]
    return best[0], best[1]


def speeds(folder: Path, seconds: float, rate: float) -> Table:
    """Return a table of the speed of all readers."""
    for kind, name in NAMES.items():
        write(kind, folder / name, seconds, rate)
    plain, gzip = folder / "plain.hdf5", folder / NAMES["mvsec"]
    write_plain_mvsec(plain, folder / NAMES["mvsec"])
    dsec = [folder / f"dsec/events/{side}/events.h5" for side in ("left", "right")]
    bag, aedat4 = folder / NAMES["rosbag1"], folder / NAMES["aedat4"]
    rows: list[tuple[str, Path, str, Callable[[], int] | None]] = [
        ("ROS 1 bag", bag, "rosbags", lambda: rosbags_objects(bag)),
        ("MCAP (ROS 2, zstd)", folder / NAMES["mcap"], "", None),
        ("MVSEC HDF5", plain, "h5py alone", lambda: h5py_columns(plain)),
        ("MVSEC HDF5 (gzip)", gzip, "h5py alone", lambda: h5py_columns(gzip)),
        ("DSEC HDF5", folder / "dsec", "evlib", lambda: evlib_both(*dsec)),
        ("AEDAT4", aedat4, "dv-processing", lambda: dv_processing(aedat4)),
    ]
    table = Table("format", "gpvo M/CPU s", "M/s", "other", "M/CPU s", "M/s", "ratio (CPU)")
    for name, path, other, read in rows:
        found = speed(lambda path=path: ours(path))  # type: ignore[misc]
        theirs = speed(read) if read else None
        assert found is not None
        cells = [f"{found[0]:.1f}", f"{found[1]:.1f}", other]
        if theirs:
            cells += [f"{theirs[0]:.2f}", f"{theirs[1]:.2f}", f"{found[0] / theirs[0]:.1f}"]
        elif read:
            cells += ["not installed"]
        table.add_row(name, *cells)
    return table


def peak_memory(bag: Path) -> str:
    """Measure the peak resident memory and speed of a process that reads a recording."""
    command = [sys.executable, "-m", "benchmarks.recordings", "--read", str(bag)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def read_and_report(path: Path) -> None:
    """Read a recording and print time and memory."""
    began, cpu = time.perf_counter(), time.process_time()
    count = ours(path)
    spent, used = time.perf_counter() - began, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{path.stat().st_size / 1e9:.2f} GB, {count:,} events in {spent:.0f} s, {used:.0f} CPU s:"
        f" {count / used / 1e6:.1f} M events per CPU second; peak resident memory {peak:.0f} MB"
    )


def main() -> None:
    """Print the table, or measure the memory."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=positive, default=4.0)
    parser.add_argument("--rate", type=positive, default=1e6, help="events per second and camera")
    parser.add_argument("--bag-size", type=positive, help="GB; measure memory instead")
    parser.add_argument("--read", type=Path, help="read a recording and print what it took")
    options = parser.parse_args()
    if options.read:
        read_and_report(options.read)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if options.bag_size:
            seconds = options.bag_size * 1e9 / (2 * 13 * options.rate)
            write("rosbag1", folder / "long.bag", seconds, options.rate)
            print(peak_memory(folder / "long.bag"))
        else:
            Console(width=110).print(speeds(folder, options.seconds, options.rate))


if __name__ == "__main__":
    exit_with(main)
