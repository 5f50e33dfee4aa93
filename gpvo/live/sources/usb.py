"""Cameras at this computer's USB: Prophesee EVK3 and EVK4, DAVIS346, DVXplorer.

Needs the extra `usb`, neuromorphic-drivers.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gpvo.errors import InputError
from gpvo.recordings.streams import EventBlock

TIMEOUT = 0.001
"""Seconds that a look at a camera without news takes."""


class UsbCamera:
    """The events of one camera."""

    def __init__(self, device: Any) -> None:
        self._device = device

    def read(self) -> EventBlock | None:
        """Return what arrived since the last call, perhaps nothing; None if the camera is gone."""
        try:
            _, packet = next(self._device)
        except (StopIteration, RuntimeError, OSError):
            return None
        events = None if packet is None else packet.polarity_events
        if events is None or len(events) == 0:
            return EventBlock.empty()
        t_ns = events["t"].astype(np.int64) * 1000
        x, y = (np.ascontiguousarray(events[name]) for name in "xy")
        return EventBlock(x, y, t_ns, events["on"].astype(bool))

    def close(self) -> None:
        """Let the camera go."""
        self._device.close()


def open_usb_camera(serial: str) -> UsbCamera:
    """Open a camera by its serial number.

    Raises
    ------
    InputError
        If it is not there, or may not be opened.
    """
    nd = _drivers()
    try:
        device = nd.open(serial=serial, iterator_timeout=TIMEOUT)
        device.__enter__()
    except (RuntimeError, OSError) as error:
        raise InputError(
            f"usb camera {serial}: cannot be opened ({error}); cameras that are seen:"
            f" {_seen(nd)}; is it plugged in, may you use it (neuromorphic-drivers-install-udev-"
            "rules), is it open elsewhere?"
        ) from error
    return UsbCamera(device)


def _seen(nd: Any) -> str:
    try:
        found = [f"{each.name} {each.serial}" for each in nd.list_devices()]
    except (RuntimeError, OSError) as error:
        return f"the USB cannot be read ({error})"
    return ", ".join(found) or "none"


def _drivers() -> Any:
    try:
        import neuromorphic_drivers
    except ImportError as error:
        raise InputError("cameras at the USB: pip install 'gpvo[usb]'") from error
    return neuromorphic_drivers
