"""Events in time order: small disorder is sorted, events with absurd stamps are dropped."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator

import numpy as np
import pytest
from encoders import event_block
from hypothesis import given, settings
from hypothesis import strategies as st
from reading import assert_same_events

from gpvo.recordings.checks import time_order
from gpvo.recordings.checks.time_order import DROPPED, SORTED, in_order, longest_nondecreasing
from gpvo.recordings.streams import EventBlock, Faults


def pieces(block: EventBlock, size: int) -> Iterator[EventBlock]:
    for first in range(0, len(block), size):
        yield block[first : first + size]


def ordered(block: EventBlock, size: int = 500) -> tuple[EventBlock, Faults]:
    faults = Faults()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time_order, "HELD_BACK", 50)
        return EventBlock.concatenate(list(in_order(pieces(block, size), faults))), faults


def retimed(block: EventBlock, t_ns: np.ndarray) -> EventBlock:
    return EventBlock(block.x, block.y, t_ns, block.polarity)


@settings(deadline=None, max_examples=100)
@given(values=st.lists(st.integers(-20, 20), max_size=60), before=st.integers(-25, 10))
def test_longest_nondecreasing(values: list[int], before: int) -> None:
    chain = longest_nondecreasing(np.array(values, np.int64), before)
    picked = [values[index] for index in chain]
    assert picked == sorted(picked) and all(value >= before for value in picked)
    assert sorted(set(chain)) == list(chain)
    tails: list[int] = []
    for value in values:
        if value >= before:
            place = bisect_right(tails, value)
            tails[place : place + 1] = [value]
    assert len(chain) == len(tails)


@pytest.mark.parametrize("size", [1, 7, 500, 5000])
def test_order_is_left_alone(size: int) -> None:
    block = event_block(2000, 1)
    ours, faults = ordered(block, size)
    assert_same_events(ours, block)
    assert not +faults


@pytest.mark.parametrize("size", [60, 500, 5000])
def test_small_disorder_is_sorted(size: int) -> None:
    """Jitter of a few milliseconds, also across blocks, loses no events."""
    block = event_block(2000, 2)
    jitter = np.random.default_rng(0).integers(0, 3_000_000, len(block))
    ours, faults = ordered(retimed(block, block.t_ns + jitter), size)
    expected = retimed(block, block.t_ns + jitter)
    assert len(ours) == 2000 and (np.diff(ours.t_ns) >= 0).all()
    np.testing.assert_array_equal(ours.t_ns, np.sort(expected.t_ns))
    assert faults[SORTED] > 0 and faults[DROPPED] == 0


@settings(deadline=None, max_examples=60)
@given(
    bad=st.dictionaries(
        st.integers(0, 1999), st.integers(-(2**62), 2**62), min_size=1, max_size=12
    ),
    size=st.sampled_from([90, 500, 5000]),
)
def test_damaged_stamps_cost_their_events_only(bad: dict[int, int], size: int) -> None:
    block = event_block(2000, 3)
    t_ns = block.t_ns.copy()
    places = np.array(list(bad))
    t_ns[places] = list(bad.values())
    ours, faults = ordered(retimed(block, t_ns), size)
    credible = (t_ns > block.t_ns[0] - 10**7) & (t_ns < block.t_ns[-1] + 6 * 10**10)
    assert credible[places].any() or len(ours) == 2000 - len(bad)
    assert (np.diff(ours.t_ns) >= 0).all()
    good = np.delete(np.arange(2000), places)
    assert np.isin(block.t_ns[good], ours.t_ns).all()
    assert faults[DROPPED] >= 2000 - len(ours)


def test_a_step_that_overflows_is_a_fault() -> None:
    """From the largest stamp to the smallest it is 1 in int64."""
    block = event_block(2000, 6)
    t_ns, limits = block.t_ns.copy(), np.iinfo(np.int64)
    t_ns[[1000, 1001]] = limits.max, limits.min
    ours, faults = ordered(retimed(block, t_ns))
    np.testing.assert_array_equal(ours.t_ns, np.delete(block.t_ns, [1000, 1001]))
    assert faults[DROPPED] == 2


def test_a_pause_is_no_fault() -> None:
    first, second = event_block(800, 4), event_block(900, 5)
    late = retimed(second, second.t_ns + 300 * 10**9)
    ours, faults = ordered(EventBlock.concatenate([first, late]))
    assert len(ours) == 1700
    assert not +faults
