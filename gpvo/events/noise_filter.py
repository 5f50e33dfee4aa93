"""Filters of single events before clustering: background activity, hot pixels, repeated events.

Events of contours come together; background activity, leak and shot noise, comes alone.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.config import ClusteringConfig
from gpvo.events.noise_kernels import (
    BACKGROUND,
    HOT,
    KEPT,
    LATEST,
    age_kernel,
    copy_kept_kernel,
    judge_kernel,
)
from gpvo.events.noise_rate import (
    ISOLATED,
    WINDOW,
    block_lengths,
    noise_rate,
    passing_share,
    spread_blocks,
    support_time,
    windows,
)
from gpvo.recordings import Events

CLEAN = 0.75
"""Noise rate below which a stream is left alone, events per pixel and second."""
MOST = 0.4
"""Share of the events from which on less noise harms contours, too: in the dark, in slow motion."""
FEW = 0.1
"""Share of the events below which noise does no harm: in fast motion there are many others."""
MANY = 200_000
"""Events of a window from which it takes long to judge them all."""
UNSEEN = 3
"""Windows that pass unseen after one of MANY events and no noise."""


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
        rows, columns = map(block_lengths, (height, width))
        self._counts = spread_blocks(len(rows), len(columns))
        self._exposure = np.outer(rows, columns) * self._counts * np.float64(WINDOW)
        self._isolated = np.zeros(self._counts.shape, np.int64)
        self._seen = np.zeros_like(self._isolated)
        self._automatic = config.background_filter is None
        self._support = config.background_filter or 0.0
        self._hot = config.hot_pixel_ratio
        self._window: int | None = None
        self._next_seen, self._aged = -1, 0
        self._judged, self._is_clean = 0, True
        self._rates, self._is_whole = np.zeros(2), True
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
        noise = noise_rate(self._isolated, self._seen, self._exposure)
        now = np.array([noise, self._seen.sum() / self._exposure.sum()])
        if not np.isfinite(self._noise[-1].begin):
            self._rates = now
        elif self._is_whole:
            self._rates = 0.7 * self._rates + 0.3 * now
        self._is_whole = True
        rate, of_all = self._rates
        is_harmful = rate > 0 and (rate >= CLEAN or rate >= MOST * of_all)
        noisy = is_harmful and rate >= FEW * now[1]
        if self._automatic:
            self._support = support_time(rate) if noisy else 0.0
        share = passing_share(rate, self._support) if self._support > 0 else 1.0
        self._noise.append(Noise(window * WINDOW, t, rate, rate * share if noisy else 0.0))

    def _judge(self, events: Events, window: int, fate: NDArray[np.uint8]) -> None:
        """Write what becomes of the events (N,) of a window."""
        if len(events) == 0:
            return
        if self._aged != window:
            age_kernel(self._pixels, np.float32((window - self._aged) * WINDOW))
            self._aged = window
        judge_kernel(
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
    copy_kept_kernel(fate, *columns, kept.x, kept.y, kept.t, kept.polarity)
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
