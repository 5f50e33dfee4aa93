"""Trajectory file that grows during the estimation, so that a crash or a kill loses little."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from gpvo.errors import InputError
from gpvo.observer import Observer, Step
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.tum import tum_lines

log = logging.getLogger("gpvo.run")

UNFINISHED = "unfinished: the poses that were final when gpvo run last wrote, or was stopped"
"""Comment in the first line of an unfinished file; a finished file has none."""


@contextmanager
def live_file(path: Path, start_ns: Callable[[], int]) -> Iterator[Observer]:
    """Write a TUM file; its observer appends, in whole lines, the poses that have become final.

    If the recording turns out to be faulty, the file is removed, so that it is not mistaken for a
    result. If the disk is full, the file grows no more, and the work goes on.

    Parameters
    ----------
    start_ns
        Function that returns the absolute stamp of t = 0, nanoseconds, once there are states.
    """
    last, grows = -np.inf, True
    try:
        # Without a buffer every write is on disk as a whole.
        with path.open("wb", buffering=0) as file:
            file.write(f"# {UNFINISHED}\n".encode("ascii"))

            def append_final(step: Step) -> None:
                nonlocal last, grows
                final = step.estimator.final_states(last)
                if len(final) and grows:
                    stamps_ns = start_ns() + np.rint(final.t * 1e9).astype(np.int64)
                    lines = tum_lines(StampedPoses(stamps_ns, final.T_world_cam))
                    last = final.t[-1]
                    try:
                        file.write("".join(lines).encode("ascii"))
                    except OSError as error:
                        grows = False
                        log.warning("%s: grows no more (%s); the run goes on", path, error.strerror)

            yield append_final
    except InputError:
        path.unlink(missing_ok=True)
        raise
