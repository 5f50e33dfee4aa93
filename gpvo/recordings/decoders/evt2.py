"""Decoders of Prophesee's byte streams EVT2 and EVT2.1."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.recordings.decoders.evt3 import LARGEST_VECTOR, decoded
from gpvo.recordings.streams import EventBlock


class Evt2:
    """Decoder of EVT2, 32-bit words; stamps are the sensor's microseconds, 34 bits (4.8 hours)."""

    word = np.dtype("<u4")

    def __init__(self) -> None:
        self._state = np.array([-1], np.int64)

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
        self._state = np.array([-1], np.int64)

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
def _evt2(words, used, state, x, y, t_us, polarity):  # type: ignore[no-untyped-def]
    count, room = 0, len(x) - LARGEST_VECTOR
    high = state[0]
    while used < len(words) and count <= room:
        word = np.int64(words[used])
        used += 1
        code = word >> 28
        if code <= 1:
            if high >= 0:
                x[count], y[count] = word >> 11 & 0x7FF, word & 0x7FF
                t_us[count], polarity[count] = high << 6 | (word >> 22 & 0x3F), code == 1
                count += 1
        elif code == 0x8:
            high = word & 0xFFFFFFF
    state[0] = high
    return used, count


@kernel
def _evt21(words, used, state, x, y, t_us, polarity):  # type: ignore[no-untyped-def]
    count, room = 0, len(x) - LARGEST_VECTOR
    high = state[0]
    while used < len(words) and count <= room:
        word = np.int64(words[used])
        used += 1
        code = word >> 60 & 0xF
        if code <= 1:
            if high >= 0:
                for bit in range(32):
                    if word >> bit & 1:
                        x[count], y[count] = (word >> 43 & 0x7FF) + bit, word >> 32 & 0x7FF
                        t_us[count], polarity[count] = high << 6 | (word >> 54 & 0x3F), code == 1
                        count += 1
        elif code == 0x8:
            high = word >> 32 & 0xFFFFFFF
    state[0] = high
    return used, count
