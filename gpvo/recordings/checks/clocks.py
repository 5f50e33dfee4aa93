"""Align the clocks of both cameras if their stamps are sensor times."""

from __future__ import annotations

from gpvo.recordings.streams import EventStream

LARGEST_DELAY_NS = 100_000_000
"""Packets of synchronised cameras arrive within this time of each other."""


def common_clock(
    left: EventStream, right: EventStream, left_first_ns: int, right_first_ns: int
) -> tuple[tuple[int, int], list[str]]:
    """Return the nanoseconds to add to the stamps of both streams, and notes for the user.

    Sensors that share a clock agree to the microsecond. Only wraps of this clock, which one
    camera may have counted before the recording began, are corrected. Arrival times place the
    recording in absolute time; they replace the sensors' clocks only if these differ.

    Parameters
    ----------
    left_first_ns, right_first_ns
        Stamps of the first events.
    """
    wrap_ns = left.wrap_ns
    if not wrap_ns or right.wrap_ns != wrap_ns:
        return (0, 0), []
    arrivals = left.arrival_offset_ns(), right.arrival_offset_ns()
    if arrivals[0] is None or arrivals[1] is None:
        wraps = round((left_first_ns - right_first_ns) / wrap_ns)
        return (0, wraps * wrap_ns), _wrap_notes(wraps, wrap_ns)
    wraps = round((arrivals[1] - arrivals[0]) / wrap_ns)
    delay_ns = arrivals[1] - arrivals[0] - wraps * wrap_ns
    if abs(delay_ns) > LARGEST_DELAY_NS:
        note = (
            "the cameras' clocks are not synchronised: they are aligned by the time of arrival"
            " only, to some milliseconds"
        )
        return (arrivals[0], arrivals[1]), [note]
    return (arrivals[0], arrivals[0] + wraps * wrap_ns), _wrap_notes(wraps, wrap_ns)


def _wrap_notes(wraps: int, wrap_ns: int) -> list[str]:
    if wraps == 0:
        return []
    shift = wraps * wrap_ns / 1e9
    return [f"the right camera's clock was {-shift:+.6f} s off (it wraps); repaired"]
