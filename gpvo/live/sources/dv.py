"""iniVation's cameras: streams that DV sends over the network, and cameras at this computer's USB.

Needs the extra `dv`, dv-processing.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gpvo.errors import InputError
from gpvo.recordings.streams import EventBlock


class DvStream:
    """The events of one reader of dv-processing, of a network stream or of a camera."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    @property
    def resolution(self) -> tuple[int, int] | None:
        """(width, height) that the sender states, or None."""
        size = self._reader.getEventResolution()
        return None if size is None else (int(size[0]), int(size[1]))

    def read(self) -> EventBlock | None:
        """Return what arrived since the last call, perhaps nothing; None if the sender is gone."""
        batch = self._reader.getNextEventBatch()
        if batch is None or batch.size() == 0:
            return EventBlock.empty() if self._reader.isRunningAny() else None
        events = batch.numpy()
        t_ns = events["timestamp"].astype(np.int64) * 1000
        # dv-processing has signed pixels; a negative one becomes one outside of the sensor.
        x, y = (events[name].astype(np.uint16) for name in "xy")
        return EventBlock(x, y, t_ns, events["polarity"] > 0)

    def close(self) -> None:
        """Close the connection or the camera."""
        self._reader = None


def open_dv_network(host: str, port: int) -> DvStream:
    """Connect to a stream of events that DV, or dv-processing's NetworkWriter, sends by TCP.

    Raises
    ------
    InputError
        If nothing is sent there, or no events.
    """
    try:
        reader = _dv().io.NetworkReader(host, port)
    except RuntimeError as error:
        raise InputError(
            f"dv://{host}:{port}: no connection ({_first_line(error)}); in DV add a Network output"
            " of the camera's events on this port, and start it before"
        ) from error
    if not reader.isEventStreamAvailable():
        raise InputError(f"dv://{host}:{port}: sends no events; choose the camera's event output")
    return DvStream(reader)


def open_dv_camera(serial: str) -> DvStream:
    """Open one of iniVation's cameras at this computer's USB by its serial number.

    Raises
    ------
    InputError
        If it is not there, or may not be opened.
    """
    dv = _dv()
    try:
        return DvStream(dv.io.camera.open(serial))
    except (RuntimeError, IndexError) as error:
        found = ", ".join(str(each.serialNumber) for each in dv.io.camera.discover()) or "none"
        raise InputError(
            f"dv-camera {serial}: cannot be opened ({_first_line(error)}); cameras that are seen:"
            f" {found}; is it plugged in, are DV's udev rules installed, is it open elsewhere?"
        ) from error


def _first_line(error: Exception) -> str:
    """Return what an error says, without where: dv-processing's has a stack trace."""
    lines = [line for line in str(error).splitlines() if line.startswith("RuntimeError: ")]
    text = lines[0].removeprefix("RuntimeError: ") if lines else str(error).splitlines()[0]
    return text.split(" [system:")[0]


def _dv() -> Any:
    try:
        import dv_processing
    except ImportError as error:
        raise InputError("iniVation's streams and cameras: pip install 'gpvo[dv]'") from error
    return dv_processing
