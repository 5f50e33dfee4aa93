"""What becomes of single events: kept, or left out as background activity, hot or repeated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.events.noise_rate import BLOCK, ISOLATED

SUPPORTERS = 2
"""Pixels around an event of a contour that had one of the same polarity shortly before."""
LEAST_HOT = 20
"""Number of recent events up to which a pixel is never judged hot."""

KEPT, BACKGROUND, HOT, REPEATED = range(4)
"""What became of an event."""
LATEST, RECENT = 0, 1
"""What is known of a pixel: see `EventFilter`."""


@kernel
def age_kernel(pixels: NDArray[np.float32], duration: np.float32) -> None:
    """Count time from a window that begins so many seconds later, and halve what was counted."""
    for pixel in pixels.reshape(-1, 2):
        pixel[LATEST] -= duration
        pixel[RECENT] *= np.float32(0.5)


@kernel
def judge_kernel(
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: NDArray[np.float64],
    polarity: NDArray[np.bool_],
    begin: float,
    pixels: NDArray[np.float32],
    counts: NDArray[np.bool_],
    isolated: NDArray[np.int64],
    seen: NDArray[np.int64],
    support: float,
    hot: float,
    fate: NDArray[np.uint8],
) -> None:
    """Judge events in order; of a clean stream, look around those of blocks that count alone."""
    for i in range(len(t)):
        row, column, now = np.intp(y[i]) + 1, np.intp(x[i]) + 1, np.float32(t[i] - begin)
        pixel = pixels[row, column]
        if pixel[LATEST] == now:
            fate[i] = REPEATED
            continue
        recent = abs(pixel[RECENT]) + np.float32(1)
        pixel[RECENT] = recent if polarity[i] else -recent
        if hot > 0 and recent > LEAST_HOT and _is_hot(pixels, row, column, hot):
            fate[i] = HOT
            continue
        block = y[i] // BLOCK, x[i] // BLOCK
        fate[i] = KEPT
        if counts[block]:
            seen[block] += 1
            isolated[block] += now - _newest_around(pixels, row, column) > ISOLATED
        if support > 0:
            since = np.float32(now - support)
            if _supporters(pixels, row, column, since) < SUPPORTERS:
                fate[i] = BACKGROUND
        pixel[LATEST] = now


@kernel
def copy_kept_kernel(
    fate: NDArray[np.uint8],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    t: NDArray[np.float64],
    polarity: NDArray[np.bool_],
    kept_x: NDArray[np.uint16],
    kept_y: NDArray[np.uint16],
    kept_t: NDArray[np.float64],
    kept_polarity: NDArray[np.bool_],
) -> None:
    """Set the columns of the events that stay, as many as there are."""
    count = 0
    for i in range(len(fate)):
        if fate[i] == KEPT:
            kept_x[count], kept_y[count] = x[i], y[i]
            kept_t[count], kept_polarity[count] = t[i], polarity[i]
            count += 1


@kernel
def _newest_around(pixels: NDArray[np.float32], row: int, column: int) -> np.float32:
    """Return the latest time of the eight pixels around one."""
    above, at, below = pixels[row - 1], pixels[row], pixels[row + 1]
    left, right = column - 1, column + 1
    newest = max(above[left, LATEST], above[column, LATEST], above[right, LATEST])
    newest = max(newest, at[left, LATEST], at[right, LATEST])
    return max(newest, below[left, LATEST], below[column, LATEST], below[right, LATEST])


@kernel
def _supporters(pixels: NDArray[np.float32], row: int, column: int, since: np.float32) -> int:
    """Count the eight pixels around one that had their latest event since a time.

    Only those of the pixel's own polarity count.
    """
    count, own = 0, pixels[row, column, RECENT] > 0
    for r in (row - 1, row, row + 1):
        for c in (column - 1, column, column + 1):
            pixel = pixels[r, c]
            alike = (pixel[LATEST] >= since) & ((pixel[RECENT] > 0) == own)
            count += alike & ((r != row) | (c != column))
    return count


@kernel
def _is_hot(pixels: NDArray[np.float32], row: int, column: int, ratio: float) -> bool:
    """Compare a pixel's number of recent events with those of the eight pixels around it."""
    own, total = abs(pixels[row, column, RECENT]), np.float32(0)
    for r in (row - 1, row, row + 1):
        for c in (column - 1, column, column + 1):
            total += abs(pixels[r, c, RECENT])
    return bool(own > ratio * ((total - own) / 8 + 1))
