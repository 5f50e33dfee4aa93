"""Waiting events: parts of any lengths are the same events as all of them together."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpvo.recordings import Events
from gpvo.recordings.event_queue import EventQueue


def numbered(t: list[int]) -> Events:
    """Make events of the pixels 0, 1, 2, ..."""
    count = len(t)
    x, y = np.arange(count, dtype=np.uint16), np.zeros(count, np.uint16)
    return Events(x, y, np.array(t, float), np.ones(count, bool))


@given(
    t=st.lists(st.integers(0, 20), max_size=40).map(sorted),
    cuts=st.lists(st.integers(0, 40), max_size=5).map(sorted),
    stops=st.lists(st.integers(-1, 22), min_size=1, max_size=4).map(sorted),
)
def test_parts_are_as_good_as_all_events_together(
    t: list[int], cuts: list[int], stops: list[int]
) -> None:
    events, queue = numbered(t), EventQueue()
    for first, last in zip([0, *cuts], [*cuts, len(t)], strict=True):
        queue.add(events[first:last])
    begin = -np.inf
    for stop in stops:
        waiting = events.between(begin, np.inf)
        assert len(queue) == len(waiting)
        assert queue.first == (waiting.t[0] if len(waiting) else np.inf)
        assert queue.last == (waiting.t[-1] if len(waiting) else -np.inf)
        assert queue.count_before(stop) == len(waiting.between(-np.inf, stop))
        times = [queue.time_of(number) for number in range(len(waiting) + 1)]
        assert times == [*waiting.t.tolist(), np.inf]
        taken, expected = queue.take(stop), waiting.between(-np.inf, stop)
        assert all(map(len, taken))
        np.testing.assert_array_equal(Events.concatenate(taken).x, expected.x)
        begin = stop
