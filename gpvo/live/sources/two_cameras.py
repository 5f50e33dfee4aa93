"""Source of two cameras, each read as its driver or connection gives events."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from typing import Protocol

from gpvo.errors import InputError
from gpvo.live.sources.packet import Packet
from gpvo.recordings.streams import EventBlock

log = logging.getLogger("gpvo.live")

SILENCE = 0.5
"""Seconds without an event of either camera after which something is wrong: cameras have noise."""
RETRY = 0.5
"""Seconds between attempts to open a camera that went away."""
PAUSE = 0.001
"""Seconds between two looks at cameras without news."""


class CameraStream(Protocol):
    """The events of one camera."""

    def read(self) -> EventBlock | None:
        """Return what arrived since the last call, perhaps nothing; None if the camera is gone."""
        ...

    def close(self) -> None:
        """Let the camera go."""
        ...


class TwoCameras:
    """Source of two cameras; one that goes away is opened again when it is back.

    Parameters
    ----------
    open_left, open_right
        Open a camera.

    Raises
    ------
    InputError
        If a camera cannot be opened at first.
    """

    def __init__(
        self, open_left: Callable[[], CameraStream], open_right: Callable[[], CameraStream]
    ) -> None:
        self._sides = _Side("left", open_left), _Side("right", open_right)
        self._is_open = True
        self._heard = time.perf_counter()
        self._is_silent = False

    def packets(self) -> Iterator[Packet]:
        """Yield the events as they arrive; an empty packet at least every `PAUSE` or so."""
        while self._is_open:
            left, right = (side.read() for side in self._sides)
            now = time.perf_counter()
            after_gap = self._after_gap(len(left) + len(right) > 0, now)
            yield Packet(left, right, now, after_gap)
            if len(left) + len(right) == 0:
                time.sleep(PAUSE)

    def close(self) -> None:
        """Let both cameras go."""
        self._is_open = False
        for side in self._sides:
            side.close()

    def _after_gap(self, is_heard: bool, now: float) -> bool:
        """Return whether these are the first events after a silence; say when one begins."""
        silent = now - self._heard
        if not is_heard:
            if silent > SILENCE and not self._is_silent:
                self._is_silent = True
                log.warning("no events for %.1f s: the pose is extrapolated", silent)
            return False
        was_silent, self._is_silent, self._heard = self._is_silent, False, now
        if was_silent:
            log.warning("events are back after %.1f s", silent)
        return was_silent


class _Side:
    """One camera, opened again when it is back."""

    def __init__(self, name: str, open_camera: Callable[[], CameraStream]) -> None:
        self._name, self._open_camera = name, open_camera
        self._stream: CameraStream | None = open_camera()
        self._retry_at = 0.0

    def read(self) -> EventBlock:
        block = None if self._stream is None else self._stream.read()
        if block is not None:
            return block
        self._reopen()
        return EventBlock.empty()

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()
        self._stream = None

    def _reopen(self) -> None:
        if self._stream is not None:
            log.warning("the %s camera is gone; waiting for it", self._name)
            self.close()
        if time.perf_counter() < self._retry_at:
            return
        self._retry_at = time.perf_counter() + RETRY
        try:
            self._stream = self._open_camera()
        except InputError:
            return
        log.warning("the %s camera is back", self._name)
