"""Filters of single events before clustering: background activity, hot pixels, repeated events.

Events of contours come together; background activity, leak and shot noise, comes alone. An event is
isolated if none of the eight pixels around it had one shortly before. Where no contour is, a sensor
with r noise events per pixel and second has r exp(-8 r ISOLATED) isolated ones, which gives r while
the stream runs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.config import ClusteringConfig
from gpvo.recordings import Events

ISOLATED = 0.005
"""An event is isolated if the pixels around had none for this time before, seconds."""
WINDOW = 0.1
"""Time after which the noise rate is found again, and old counts of a pixel halve, seconds."""
BLOCK = 16
"""Side of the blocks of pixels whose isolated events are counted."""
ENOUGH = 256
"""Number of blocks, spread evenly, that tell the noise rate of a large sensor."""
QUIET = 0.25
"""Share of the blocks with events that are taken for noise alone, the quietest ones."""
CLEAN = 0.75
"""Noise rate below which a stream is left alone, events per pixel and second."""
FEW = 0.1
"""Share of the events below which noise does no harm: in fast motion there are many others."""
SUPPORTERS = 2
"""Pixels around an event of a contour that had one of the same polarity shortly before."""
EXPECTED = 0.53
"""Mean number of them that noise has by chance: a tenth of it has two or more, and passes."""
LEAST_HOT = 20
"""Number of recent events up to which a pixel is never judged hot."""
MANY = 200_000
"""Events of a window from which it takes long to judge them all."""
UNSEEN = 3
"""Windows that pass unseen after one of MANY events and no noise."""

KEPT, BACKGROUND, HOT, REPEATED = range(4)
"""What became of an event."""
LATEST, RECENT = 0, 1
"""What is known of a pixel: see `EventFilter`."""


@dataclass(frozen=True)
class Noise:
    """Background activity from a time on, events per pixel and second.

    Attributes
    ----------
    begin
        Seconds.
    known
        Time of the event that ended the window before, seconds.
    rate
        All of it; 0 before it is known.
    passing
        What passes the filter, as an estimate; 0 for a clean stream.
    """

    begin: float
    known: float
    rate: float
    passing: float


class EventFilter:
    """Noise filter of one camera, which remembers its pixels between batches.

    An event stays if SUPPORTERS of the pixels around had their latest one within a support time
    before, of the same polarity: after Delbruck, "Frame-free dynamic digital vision", 2008, where
    it is one of any polarity. Contours are lines and keep their polarity, so that the time may be
    as long as slow ones need. It is set, or follows from the noise rate: noise has EXPECTED such
    pixels.

    An event that repeats pixel and time of the one before is left out: a topic that was recorded
    twice does no harm. A large sensor's stream that has none of all this is looked at in one of
    several windows only, and in the time before it that tells which events are isolated.

    What it says of a time follows from the events before that time, however they come in batches:
    it may be asked in one thread while another one gives it events.
    """

    def __init__(self, resolution: tuple[int, int], config: ClusteringConfig) -> None:
        width, height = resolution
        # Of each pixel the time of the latest event, seconds since the window began, and the number
        # of recent events, negative if the latest one is an OFF event. A border of one pixel, so
        # that every pixel has eight neighbours. They are read and written at random, which takes a
        # third less time in 32 bits, and again where they lie together.
        self._pixels = np.zeros((height + 2, width + 2, 2), np.float32)
        self._pixels[..., LATEST] = -np.inf
        rows, columns = map(_block_lengths, (height, width))
        self._counts = _spread(len(rows), len(columns))
        self._exposure = np.outer(rows, columns) * self._counts * np.float64(WINDOW)
        self._isolated = np.zeros(self._counts.shape, np.int64)
        self._seen = np.zeros_like(self._isolated)
        self._automatic = config.background_filter is None
        self._support = config.background_filter or 0.0
        self._hot = config.hot_pixel_ratio
        self._window: int | None = None
        self._next_seen, self._aged = -1, 0
        self._judged, self._is_clean = 0, True
        self._is_whole = True
        self._noise = deque([Noise(-np.inf, -np.inf, 0.0, 0.0)])
        self._left_out = deque[NDArray[np.float64]](), deque[NDArray[np.float64]]()

    def noise(self, start: float, stop: float) -> Noise:
        """Return the background activity at `start` as the events before `stop` tell it, seconds.

        Both are not before those asked last.
        """
        while len(self._noise) > 1 and self._noise[1].begin <= start:
            if self._noise[1].known >= stop:
                break
            self._noise.popleft()
        return self._noise[0]

    def left_out(self, stop: float) -> tuple[int, int]:
        """Count the events before `stop`, seconds, that were left out since it was asked last.

        They are background activity, and of hot pixels.
        """
        background, hot = (_take_before(times, stop) for times in self._left_out)
        return background, hot

    def interrupt(self) -> None:
        """Say that events are missing: until a window has all of them the noise stays as it was."""
        self._is_whole = False

    def __call__(self, events: Events) -> Events:
        """Return the events that are not noise."""
        if not self._automatic and self._support == 0 and self._hot == 0:
            return events
        fate = np.zeros(len(events), np.uint8)
        for window, first, last in windows(events.t):
            self._begin(window, float(events.t[first]))
            first += int(np.searchsorted(events.t[first:last], self._seen_from))
            self._judge(events[first:last], window, fate[first:last])
        if fate.max(initial=KEPT) == KEPT:
            return events
        for times, kind in zip(self._left_out, (BACKGROUND, HOT), strict=True):
            if (those := fate == kind).any():
                times.append(events.t[those])
        return _kept(events, fate)

    def _begin(self, window: int, t: float) -> None:
        """Learn from the window that ended, if one begins with the event at `t`."""
        if self._window == window:
            return
        if self._window is not None and self._window >= self._next_seen:
            self._learn(window, t)
            is_long = self._is_clean and self._support == 0 and self._judged > MANY
            self._next_seen = window + UNSEEN * is_long
        self._isolated[:], self._seen[:] = 0, 0
        self._window, self._judged, self._is_clean = window, 0, True

    @property
    def _seen_from(self) -> float:
        """Time from which events are judged, seconds."""
        return self._next_seen * WINDOW - 2 * ISOLATED

    def _learn(self, window: int, t: float) -> None:
        """Find the noise rate of the window that ended when one began with the event at `t`."""
        rate, before = noise_rate(self._isolated, self._seen, self._exposure), self._noise[-1]
        if np.isfinite(before.begin):
            rate = 0.7 * before.rate + 0.3 * rate if self._is_whole else before.rate
        self._is_whole = True
        noisy = rate >= max(CLEAN, FEW * self._seen.sum() / self._exposure.sum())
        if self._automatic:
            self._support = support_time(rate) if noisy else 0.0
        share = passing_share(rate, self._support) if self._support > 0 else 1.0
        self._noise.append(Noise(window * WINDOW, t, rate, rate * share if noisy else 0.0))

    def _judge(self, events: Events, window: int, fate: NDArray[np.uint8]) -> None:
        """Write what becomes of the events (N,) of a window."""
        if len(events) == 0:
            return
        if self._aged != window:
            _age(self._pixels, np.float32((window - self._aged) * WINDOW))
            self._aged = window
        _judge(
            events.x,
            events.y,
            events.t,
            events.polarity,
            window * WINDOW,
            self._pixels,
            self._counts,
            self._isolated,
            self._seen,
            self._support,
            self._hot,
            fate,
        )
        self._judged += len(events)
        self._is_clean &= not fate.any()


def _kept(events: Events, fate: NDArray[np.uint8]) -> Events:
    """Return the events (N,) that stay; one pass takes a third of the time of one per column."""
    kept = Events.empty(int(np.count_nonzero(fate == KEPT)))
    columns = events.x, events.y, events.t, events.polarity
    _copy_kept(fate, *columns, kept.x, kept.y, kept.t, kept.polarity)
    return kept


def _take_before(times: deque[NDArray[np.float64]], stop: float) -> int:
    """Remove the times, in order, before `stop`, and return their number."""
    count = 0
    while times:
        part = times.popleft()
        before = int(np.searchsorted(part, stop))
        count += before
        if before < len(part):
            times.appendleft(part[before:])
            break
    return count


def windows(t: NDArray[np.float64]) -> Iterator[tuple[int, int, int]]:
    """Cut times (N,) at multiples of WINDOW; yield window, first index and end of the parts."""
    first = 0
    while first < len(t):
        window = window_of(float(t[first]))
        last = int(np.searchsorted(t, (window + 1) * WINDOW))
        yield window, first, last
        first = last


def window_of(t: float) -> int:
    """Return the number n of a window, n WINDOW <= t < (n + 1) WINDOW as rounded products."""
    n = int(t / WINDOW)
    return n + (t >= (n + 1) * WINDOW) - (t < n * WINDOW)


def support_time(rate: float) -> float:
    """Return the time in which pixels around must have fired, seconds, at a noise rate.

    Noise has half of its events in each polarity.
    """
    return EXPECTED / (4 * rate)


def passing_share(rate: float, support: float) -> float:
    """Return the share of the noise that has two or more supporters within a time, seconds."""
    expected = 4 * rate * support
    return float(1 - (1 + expected) * np.exp(-expected))


def _block_lengths(length: int) -> NDArray[np.int64]:
    """Return the sides of the blocks along an image's side, pixels; the last may be short."""
    return np.clip(length - BLOCK * np.arange(length // BLOCK + 1), 0, BLOCK)


def _spread(rows: int, columns: int) -> NDArray[np.bool_]:
    """Choose about ENOUGH blocks (rows, columns), or all, in every so many rows and columns."""
    chosen = np.zeros((rows, columns), np.bool_)
    step = max(1, int(np.sqrt(rows * columns / ENOUGH)))
    chosen[::step, ::step] = True
    return chosen


def noise_rate(
    isolated: NDArray[np.int64], seen: NDArray[np.int64], exposure: NDArray[np.float64]
) -> float:
    """Estimate the background activity, events per pixel and second.

    `isolated` and `seen` are numbers of isolated and of all events, block by block; `exposure` is
    the blocks' number of pixels times the time, seconds. Of small blocks at the border too few
    events come to tell a rate.
    """
    active = (seen > 0) & (exposure >= exposure.max() / 2)
    rates = np.sort(isolated[active] / exposure[active])
    if len(rates) == 0:
        return 0.0
    rate = least = rates[int(QUIET * (len(rates) - 1))]
    for _ in range(10):  # rate exp(-8 rate ISOLATED) = least, for rates up to 1 / (8 ISOLATED)
        rate = min(least * np.exp(8 * rate * ISOLATED), 1 / (8 * ISOLATED))
    return float(rate)


@kernel
def _age(pixels: NDArray[np.float32], duration: np.float32) -> None:
    """Count time from a window that begins so many seconds later, and halve what was counted."""
    for pixel in pixels.reshape(-1, 2):
        pixel[LATEST] -= duration
        pixel[RECENT] *= np.float32(0.5)


@kernel
def _judge(
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
def _copy_kept(
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
