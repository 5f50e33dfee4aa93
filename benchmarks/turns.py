"""Timing of contestants in turns, so that other load on the machine affects all alike."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np


def fastest(
    contestants: dict[str, Callable[[], object]], rounds: int, each: int
) -> dict[str, float]:
    """Measure the seconds of one call of each contestant, in turns; the fastest round counts."""
    best = dict.fromkeys(contestants, np.inf)
    for _ in range(rounds):
        for name, call in contestants.items():
            begin = time.perf_counter()
            for _ in range(each):
                call()
            best[name] = min(best[name], (time.perf_counter() - begin) / each)
    return best
