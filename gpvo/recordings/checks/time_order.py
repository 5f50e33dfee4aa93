"""Put events in time order: sort small disorder, and drop events with absurd stamps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.recordings.streams import EventBlock, Faults

DISORDER_NS = 10_000_000
"""Events that are late or early by less than this are sorted; others have damaged stamps."""

LONGEST_GAP_NS = 60_000_000_000
FEWEST_AFTER_GAP = 16
"""A camera always has noise: fewer events beyond such a gap have damaged stamps."""

HELD_BACK = 4096
"""Number of events at the end of a block that wait until the next block confirms them."""

SORTED = "events out of order of time by less than 10 ms were sorted"
DROPPED = "events with stamps that do not fit to those around them were left out"


def in_order(blocks: Iterator[EventBlock], faults: Faults) -> Iterator[EventBlock]:
    """Yield the events in time order, without those that have absurd stamps.

    The longest sequence of events with non-decreasing stamps is taken as correct, as the fewest
    events are dropped then. Events are yielded once the following ones have confirmed them.
    """
    held, before = EventBlock.empty(), np.iinfo(np.int64).min
    for block in blocks:
        if len(block) == 0:
            continue
        if _continues(held.t_ns, block.t_ns, before) and (settled := _settled(block.t_ns)):
            yield from (part for part in (held, block[:settled]) if len(part))
            before, held = int(block.t_ns[settled - 1]), block[settled:]
        else:
            ordered = _ordered(EventBlock.concatenate([held, block]), before, faults)
            settled = _settled(ordered.t_ns)
            if settled:
                before = int(ordered.t_ns[settled - 1])
                yield ordered[:settled]
            held = ordered[settled:]
    if len(held):
        yield held


def _settled(t_ns: NDArray[np.int64]) -> int:
    """Return the number of events that no event of a later block can precede."""
    if len(t_ns) <= HELD_BACK:
        return 0
    # A stamp from the future among those held back must not decide what is recent.
    recent = t_ns[-HELD_BACK] - DISORDER_NS
    return int(np.searchsorted(t_ns, recent, side="left"))


def _continues(held: NDArray[np.int64], t_ns: NDArray[np.int64], before: int) -> bool:
    """Return whether stamps need no sorting after those that are held back; they need no join."""
    if len(held) == 0:
        return _is_plain(t_ns, before)
    near = int(t_ns[0]) - int(held[-1]) < LONGEST_GAP_NS
    return near and _is_plain(held, before) and _is_plain(t_ns, held[-1])


@kernel
def _is_plain(t_ns, before):  # type: ignore[no-untyped-def]
    """Return whether stamps (N,) do not decrease, from `before` on, and have no long gap."""
    plain = t_ns[0] >= before
    for i in range(1, len(t_ns)):
        step = t_ns[i] - t_ns[i - 1]
        # Damaged stamps overflow: a step from the largest to the smallest one is 1.
        plain &= (t_ns[i] >= t_ns[i - 1]) & (step >= 0) & (step < LONGEST_GAP_NS)
    return plain


def _ordered(block: EventBlock, before: int, faults: Faults) -> EventBlock:
    """Return one block in time order, from the time `before` on."""
    t_ns = block.t_ns
    if _is_plain(t_ns, before):
        return block
    chain = longest_nondecreasing(t_ns, before)
    chain = _without_islands(chain, t_ns, before)
    keep = _near_chain(t_ns, chain, before)
    faults[SORTED] += int(keep.sum()) - len(chain)
    faults[DROPPED] += len(block) - int(keep.sum())
    kept = block[keep]
    return kept[np.argsort(kept.t_ns, kind="stable")]


@kernel
def longest_nondecreasing(t_ns, before):  # type: ignore[no-untyped-def]
    """Return indices (M,) int64 of a longest non-decreasing subsequence of values >= before."""
    count = len(t_ns)
    tails = np.empty(count, np.int64)
    previous = np.full(count, -1, np.int64)
    length = 0
    for index in range(count):
        time = t_ns[index]
        if time < before:
            continue
        low, high = 0, length
        if length > 0 and t_ns[tails[length - 1]] <= time:
            low = length
        while low < high:
            middle = (low + high) // 2
            if t_ns[tails[middle]] <= time:
                low = middle + 1
            else:
                high = middle
        if low > 0:
            previous[index] = tails[low - 1]
        tails[low] = index
        length = max(length, low + 1)
    chain = np.empty(length, np.int64)
    at = tails[length - 1] if length > 0 else -1
    for place in range(length - 1, -1, -1):
        chain[place] = at
        at = previous[at]
    return chain


def _without_islands(
    chain: NDArray[np.int64], t_ns: NDArray[np.int64], before: int
) -> NDArray[np.int64]:
    """Return the chain without small groups of events that are far from all others."""
    if len(chain) == 0:
        return chain
    breaks = np.flatnonzero(_gaps(t_ns[chain]) > LONGEST_GAP_NS) + 1
    islands = np.split(chain, breaks)
    if len(islands) == 1:
        return chain
    longest = max(len(island) for island in islands)
    few = min(FEWEST_AFTER_GAP, longest)
    return np.concatenate([island for island in islands if len(island) >= few])


def _gaps(t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return differences as float64, which cannot overflow, as damaged stamps may be anything."""
    return np.diff(t_ns.astype(np.float64))


def _near_chain(
    t_ns: NDArray[np.int64], chain: NDArray[np.int64], before: int
) -> NDArray[np.bool_]:
    """Return which events belong to the chain or lie within the sortable disorder around it."""
    if len(chain) == 0:
        return np.zeros(len(t_ns), bool)
    place = np.clip(np.searchsorted(chain, np.arange(len(t_ns)), side="right") - 1, 0, None)
    expected = t_ns[chain[place]].astype(np.float64)
    near = np.abs(t_ns - expected) < DISORDER_NS
    near &= t_ns >= before
    return near
