"""Trajectory file that grows during the estimation, so that a crash or a kill loses little."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import numpy as np

from gpvo.errors import InputError
from gpvo.odometry import Odometry
from gpvo.trajectory.tum import TumWriter

UNFINISHED = "unfinished: the poses that were final when gpvo run last wrote, or was stopped"
"""Comment in the first line of an unfinished file; a finished file has none."""


class LiveFile:
    """TUM file to which poses are appended as soon as they are final, in whole lines.

    If the recording turns out to be faulty, the file is removed, so that it is not mistaken for a
    result.
    """

    def __init__(self, path: Path, odometry: Odometry, start_ns: int) -> None:
        self._path, self._odometry, self._start_ns = path, odometry, start_ns
        self._last = -np.inf

    def __enter__(self) -> LiveFile:
        self._writer = TumWriter(self._path, UNFINISHED)
        return self

    def append_final(self) -> None:
        """Append the poses that have become final since the last call."""
        final = self._odometry.estimator.final_states(self._last)
        for t, T_world_cam in zip(final.t.tolist(), final.T_world_cam, strict=True):
            self._writer.append(self._start_ns + round(t * 1e9), T_world_cam)
            self._last = t

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._writer.__exit__(kind, error, traceback)
        if isinstance(error, InputError):
            self._path.unlink(missing_ok=True)
