"""Summary statistics of a series of errors, those that evo prints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Statistics:
    """Summary of a series of non-negative errors, in the series' unit."""

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    count: int

    @staticmethod
    def of(errors: NDArray[np.float64]) -> Statistics:
        """Summarise errors (N,); all numbers are NaN if there are none."""
        if len(errors) == 0:
            nan = float("nan")
            return Statistics(nan, nan, nan, nan, nan, nan, count=0)
        return Statistics(
            rmse=float(np.sqrt(np.mean(errors**2))),
            mean=float(errors.mean()),
            median=float(np.median(errors)),
            std=float(errors.std()),
            min=float(errors.min()),
            max=float(errors.max()),
            count=len(errors),
        )
