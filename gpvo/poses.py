"""Poses at absolute stamps: what ground truth files and other systems' trajectories hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class StampedPoses:
    """A sequence of poses with strictly increasing stamps.

    Attributes
    ----------
    stamps_ns
        (N,) int64, absolute nanoseconds.
    T_world_cam
        (N, 4, 4) float64 rigid transforms.
    """

    stamps_ns: NDArray[np.int64]
    T_world_cam: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.stamps_ns)
