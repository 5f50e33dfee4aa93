"""Trajectory file that grows during the estimation, so that a crash or a kill loses little."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from gpvo.errors import InputError
from gpvo.odometry import Odometry
from gpvo.trajectory.tum import TumWriter

UNFINISHED = "unfinished: the poses that were final when gpvo run last wrote, or was stopped"
"""Comment in the first line of an unfinished file; a finished file has none."""


@contextmanager
def live_file(path: Path, odometry: Odometry, start_ns: int) -> Iterator[Callable[[], None]]:
    """Write a TUM file; each call appends, in whole lines, the poses that have become final.

    If the recording turns out to be faulty, the file is removed, so that it is not mistaken for a
    result.
    """
    last = -np.inf
    try:
        with TumWriter(path, UNFINISHED) as writer:

            def append_final() -> None:
                nonlocal last
                final = odometry.estimator.final_states(last)
                for t, T_world_cam in zip(final.t.tolist(), final.T_world_cam, strict=True):
                    writer.append(start_ns + round(t * 1e9), T_world_cam)
                    last = t

            yield append_final
    except InputError:
        path.unlink(missing_ok=True)
        raise
