"""Decoder of Prophesee's byte stream EVT3, and the loop that runs the kernels of all EVT.

A decoder keeps the state that continues from one packet to the next (row, time, vector base). A
packet has any number of whole words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.recordings.streams import EventBlock

WRAP_US = 1 << 24
"""EVT3's clock starts again after 16.777 s."""

CAPACITY = 1 << 19
"""Number of events decoded at once."""

LARGEST_VECTOR = 32
"""Largest number of events in one word, that of EVT2.1."""

LARGEST_STEP = 64
"""Steps of EVT3's TIME_HIGH (4.096 ms each); a larger jump may be damage."""

LARGEST_JITTER = 10
"""Steps that EVT3's TIME_HIGH may go back without a wrap of its clock."""

Y, BASE, BASE_POLARITY, HIGH, LOW, WRAPS, READY, TRUSTED_HIGH, TRUSTED_WRAPS = range(9)
"""Indices of the state of EVT3."""


class Evt3:
    """Decoder of EVT3, 16-bit words; stamps are the sensor's microseconds, unwrapped.

    Events before the first TIME_HIGH and TIME_LOW have no time and are skipped.
    """

    word = np.dtype("<u2")

    def __init__(self) -> None:
        self._state = np.zeros(9, np.int64)
        self._state[HIGH] = self._state[TRUSTED_HIGH] = -1
        self._last_us = -1

    def decode(self, words: NDArray[np.uint16]) -> Iterator[EventBlock]:
        """Yield the events of consecutive words; t_ns is the sensor's time in nanoseconds."""
        yield from decoded(_evt3, words, self._state)

    def skip(self, words: NDArray[np.uint16]) -> None:
        """Read only the times of consecutive words, several times faster than decoding."""
        self._last_us = _evt3_times(words, self._state, self._last_us)

    def last_event(self) -> EventBlock:
        """Return the last skipped event, of which only the time is known; empty without one."""
        t_ns = np.array([self._last_us * 1000] if self._last_us >= 0 else [], np.int64)
        pixel = np.zeros(len(t_ns), np.uint16)
        return EventBlock(pixel, pixel, t_ns, pixel > 0)


def decoded(
    kernel: Callable[..., Any], words: NDArray[Any], state: NDArray[np.int64]
) -> Iterator[EventBlock]:
    """Run a kernel until all words are used, and yield the events of each full buffer."""
    used = 0
    while used < len(words):
        size = min(CAPACITY, LARGEST_VECTOR * (len(words) - used)) + LARGEST_VECTOR
        x, y = np.empty(size, np.uint16), np.empty(size, np.uint16)
        t_us, polarity = np.empty(size, np.int64), np.empty(size, np.bool_)
        used, count = kernel(words, used, state, x, y, t_us, polarity)
        if count:
            t_ns = t_us[:count] * 1000
            yield EventBlock(x[:count], y[:count], t_ns, polarity[:count])


@kernel
def _evt3(words, used, state, x, y, t_us, polarity):  # type: ignore[no-untyped-def]
    row, base, base_polarity = state[Y], state[BASE], state[BASE_POLARITY]
    count, room = 0, len(x) - LARGEST_VECTOR
    now = state[WRAPS] * WRAP_US + state[HIGH] * 4096 + state[LOW]
    valid = state[READY] == 1
    while used < len(words) and count <= room:
        word = np.int64(words[used])
        used += 1
        code, payload = word >> 12, word & 0xFFF
        if code == 0x2:
            if valid:
                x[count], y[count] = payload & 0x7FF, row
                t_us[count], polarity[count] = now, payload >> 11 == 1
                count += 1
        elif code == 0x4 or code == 0x5:
            bits, width = (payload, 12) if code == 0x4 else (payload & 0xFF, 8)
            if valid:
                for bit in range(width):
                    if bits >> bit & 1:
                        x[count], y[count] = base + bit, row
                        t_us[count], polarity[count] = now, base_polarity == 1
                        count += 1
            base += width
        elif code == 0x0:
            row = payload & 0x7FF
        elif code == 0x3:
            base, base_polarity = payload & 0x7FF, payload >> 11
        elif code == 0x6:
            state[LOW] = payload
            if state[HIGH] >= 0:
                state[READY] = 1
            now = state[WRAPS] * WRAP_US + state[HIGH] * 4096 + payload
            valid = state[READY] == 1
        elif code == 0x8:
            _time_high(payload, state)
            now = state[WRAPS] * WRAP_US + state[HIGH] * 4096 + state[LOW]
            valid = state[READY] == 1
    state[Y], state[BASE], state[BASE_POLARITY] = row, base, base_polarity
    return used, count


@kernel
def _evt3_times(words, state, last_us):  # type: ignore[no-untyped-def]
    """Update the time in `state` and return the time of the last event in microseconds."""
    now = np.int64(-1)
    if state[READY] == 1:
        now = state[WRAPS] * WRAP_US + state[HIGH] * 4096 + state[LOW]
    for index in range(len(words)):
        word = np.int64(words[index])
        code = word >> 12
        if code == 0x2 or code == 0x4 or code == 0x5:
            if now >= 0:
                last_us = now
        elif code == 0x6 or code == 0x8:
            if code == 0x8:
                _time_high(word & 0xFFF, state)
            else:
                state[LOW] = word & 0xFFF
                state[READY] = 1 if state[HIGH] >= 0 else 0
            if state[READY] == 1:
                now = state[WRAPS] * WRAP_US + state[HIGH] * 4096 + state[LOW]
    return last_us


@kernel
def _time_high(high, state):  # type: ignore[no-untyped-def]
    """Update the state by a TIME_HIGH; undo a jump that the next one does not confirm."""
    if state[HIGH] < 0:
        state[HIGH] = high
    elif _follows(state[HIGH], high):
        _advance(state[HIGH], state[WRAPS], high, state)
        state[TRUSTED_HIGH] = -1
    elif state[TRUSTED_HIGH] >= 0 and _follows(state[TRUSTED_HIGH], high):
        _advance(state[TRUSTED_HIGH], state[TRUSTED_WRAPS], high, state)
        state[TRUSTED_HIGH] = -1
    else:
        if state[TRUSTED_HIGH] < 0:
            state[TRUSTED_HIGH], state[TRUSTED_WRAPS] = state[HIGH], state[WRAPS]
        _advance(state[TRUSTED_HIGH], state[TRUSTED_WRAPS], high, state)


@kernel
def _follows(previous, high):  # type: ignore[no-untyped-def]
    step = (high - previous) & 0xFFF
    return step <= LARGEST_STEP or step >= 4096 - LARGEST_JITTER


@kernel
def _advance(previous, wraps, high, state):  # type: ignore[no-untyped-def]
    """Count a wrap if the counter starts again, and undo the wrap if the counter only jitters."""
    jitters = (high - previous) & 0xFFF >= 4096 - LARGEST_JITTER
    if jitters and high > previous:
        wraps -= 1
    if not jitters and high < previous:
        wraps += 1
    state[HIGH], state[WRAPS] = high, wraps
