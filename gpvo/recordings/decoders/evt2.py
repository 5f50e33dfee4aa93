"""Decoders of Prophesee's byte streams EVT2 and EVT2.1.

The clock starts again after 4.8 hours, and decoders count on. A damaged time does not shift those
after it, as each is taken to be the nearest one to the time before.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.recordings.decoders.evt3 import LARGEST_VECTOR, decoded
from gpvo.recordings.streams import EventBlock

WRAP_US = 1 << 34
"""The clock of EVT2 and EVT2.1 starts again after 4.8 hours."""

WRAP_HIGH = WRAP_US >> 6
"""Number of its TIME_HIGH."""

HIGH, READY = range(2)
"""Indices of the state: TIME_HIGH with wraps, and whether there was one."""


class Evt2:
    """Decoder of EVT2, 32-bit words; stamps are the sensor's microseconds, unwrapped."""

    word = np.dtype("<u4")

    def __init__(self) -> None:
        self._state = np.zeros(2, np.int64)

    def decode(self, words: NDArray[np.uint32]) -> Iterator[EventBlock]:
        """Yield the events of consecutive words; t_ns is the sensor's time in nanoseconds."""
        yield from decoded(_evt2, words, self._state)


class Evt21:
    """Decoder of EVT2.1, 64-bit words of up to 32 pixels of a row; stamps like those of EVT2.

    Parameters
    ----------
    legacy
        Whether the upper half of each word comes first, as from the IMX636.
    """

    word = np.dtype("<u8")

    def __init__(self, legacy: bool = False) -> None:
        self._legacy = legacy
        self._state = np.zeros(2, np.int64)

    def decode(self, words: NDArray[np.uint64]) -> Iterator[EventBlock]:
        """Yield the events of consecutive words; t_ns is the sensor's time in nanoseconds."""
        yield from decoded(_evt21, halves_swapped(words) if self._legacy else words, self._state)


def halves_swapped(words: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return the words with their lower and upper 32 bits swapped."""
    return words << np.uint64(32) | words >> np.uint64(32)


def looks_legacy(words: NDArray[np.uint64]) -> bool:
    """Return whether the clock of EVT2.1 is more even if its words are read as legacy ones."""
    return _clock_steps(halves_swapped(words)) > _clock_steps(words)


def _clock_steps(words: NDArray[np.uint64]) -> int:
    """Return the number of TIME_HIGH that are later than the one before, by less than a second."""
    heads = (words >> np.uint64(32)).astype(np.int64)
    steps = np.diff(heads[heads >> 28 == 8])
    return int(np.count_nonzero((steps > 0) & (steps << 6 < 1_000_000)))


@kernel
def _time_high(previous, valid, counter):  # type: ignore[no-untyped-def]
    """Return a TIME_HIGH with wraps: the nearest one to the previous, if that is valid."""
    step = (counter - previous) & (WRAP_HIGH - 1)
    if not valid:
        return counter
    return previous + (step if step < WRAP_HIGH // 2 else step - WRAP_HIGH)


@kernel
def _evt2(words, used, state, x, y, t_us, polarity):  # type: ignore[no-untyped-def]
    count, room = 0, len(x) - LARGEST_VECTOR
    high, valid = state[HIGH], state[READY] == 1
    while used < len(words) and count <= room:
        word = np.int64(words[used])
        used += 1
        code = word >> 28
        if code <= 1:
            if valid:
                x[count], y[count] = word >> 11 & 0x7FF, word & 0x7FF
                t_us[count], polarity[count] = high << 6 | (word >> 22 & 0x3F), code == 1
                count += 1
        elif code == 0x8:
            high, valid = _time_high(high, valid, word & 0xFFFFFFF), True
    state[HIGH], state[READY] = high, valid
    return used, count


@kernel
def _evt21(words, used, state, x, y, t_us, polarity):  # type: ignore[no-untyped-def]
    count, room = 0, len(x) - LARGEST_VECTOR
    high, valid = state[HIGH], state[READY] == 1
    while used < len(words) and count <= room:
        word = np.int64(words[used])
        used += 1
        code = word >> 60 & 0xF
        if code <= 1:
            if valid:
                for bit in range(32):
                    if word >> bit & 1:
                        x[count], y[count] = (word >> 43 & 0x7FF) + bit, word >> 32 & 0x7FF
                        t_us[count], polarity[count] = high << 6 | (word >> 54 & 0x3F), code == 1
                        count += 1
        elif code == 0x8:
            high, valid = _time_high(high, valid, word >> 32 & 0xFFFFFFF), True
    state[HIGH], state[READY] = high, valid
    return used, count
