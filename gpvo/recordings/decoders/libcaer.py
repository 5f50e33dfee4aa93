"""Decoders of iniVation's packets (libcaer_cmp, libcaer) and of the old encoding `mono`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.recordings.decoders.evt3 import decoded
from gpvo.recordings.streams import EventBlock


class LibcaerPacked:
    """Decoder of libcaer_cmp, 16-bit words; the times of each packet start at its time base."""

    word = np.dtype("<u2")

    def __init__(self) -> None:
        self._state = np.zeros(5, np.int64)

    def decode(self, words: NDArray[np.uint16], time_base_ns: int) -> Iterator[EventBlock]:
        """Yield the events of one packet, with absolute stamps."""
        self._state[3:] = 0
        for block in decoded(_libcaer_packed, words, self._state):
            t_ns = block.t_ns + time_base_ns // 1000 * 1000
            yield EventBlock(block.x, block.y, t_ns, block.polarity)


def records(data: NDArray[np.uint8], time_base_ns: int) -> EventBlock:
    """Return the events of one packet of libcaer's own 8-byte records, with absolute stamps."""
    table = data.view(np.dtype([("data", "<u4"), ("ts", "<i4")]))
    bits, ts = table["data"], table["ts"].astype(np.int64)
    rolls = np.concatenate([[0], np.cumsum(np.diff(ts) < 0)]) if len(ts) else ts
    t_ns = time_base_ns + 1000 * (ts + (rolls << 31))
    x, y = (bits >> 17) & 0x7FFF, (bits >> 2) & 0x7FFF
    return EventBlock(x.astype(np.uint16), y.astype(np.uint16), t_ns, (bits >> 1) & 1 == 1)


def mono(data: NDArray[np.uint8], time_base_ns: int) -> EventBlock:
    """Return the events of one packet of 8-byte records with nanoseconds since the time base."""
    bits = data.view("<u8")
    x, y = (bits >> np.uint64(32)) & np.uint64(0xFFFF), (bits >> np.uint64(48)) & np.uint64(0x7FFF)
    t_ns = time_base_ns + (bits & np.uint64(0xFFFFFFFF)).astype(np.int64)
    return EventBlock(x.astype(np.uint16), y.astype(np.uint16), t_ns, bits >> np.uint64(63) == 1)


@kernel
def _libcaer_packed(words, used, state, x, y, t_us, polarity):  # type: ignore[no-untyped-def]
    column, base, base_polarity, high, low = state
    count, room = 0, len(x) - 12
    while used < len(words) and count <= room:
        word = np.int64(words[used])
        used += 1
        code, payload = word >> 12, word & 0xFFF
        if code == 0x0:
            high = payload
        elif code == 0x1:
            low = payload
        elif code == 0x2:
            column = payload & 0x7FF
        elif code == 0x3:
            x[count], y[count] = column, payload & 0x7FF
            t_us[count], polarity[count] = high << 12 | low, payload >> 11 == 1
            count += 1
        elif code == 0x4:
            base, base_polarity = payload & 0x7FF, payload >> 11
        elif code == 0x5:
            for bit in range(8):
                if payload >> bit & 1:
                    x[count], y[count] = column, base + bit
                    t_us[count], polarity[count] = high << 12 | low, base_polarity == 1
                    count += 1
            base += 8
    state[0], state[1], state[2], state[3], state[4] = column, base, base_polarity, high, low
    return used, count
