"""Open two cameras by what the user calls them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from gpvo.errors import InputError
from gpvo.live.sources.dv import DvStream, open_dv_camera, open_dv_network
from gpvo.live.sources.two_cameras import CameraStream, TwoCameras
from gpvo.live.sources.usb import open_usb_camera
from gpvo.recordings import StereoRig
from gpvo.recordings.checks.sensor_size import check_resolution

SOURCES = "dv://HOST:LEFT_PORT,RIGHT_PORT, dv-camera://LEFT,RIGHT, usb://LEFT,RIGHT"
"""Names of cameras; LEFT and RIGHT are serial numbers."""


def is_camera(name: str) -> bool:
    """Return whether a source's name is that of cameras, not that of a recording."""
    return "://" in name


def open_cameras(name: str, rig: StereoRig) -> TwoCameras:
    """Open both cameras of a source.

    Raises
    ------
    InputError
        If the name is none, a camera cannot be opened, or it is not of the rig's resolution.
    """
    left, right = _openers(name)
    left, right = _checked(left, rig.left.resolution), _checked(right, rig.right.resolution)
    return TwoCameras(left, right)


def _openers(name: str) -> tuple[Callable[[], CameraStream], Callable[[], CameraStream]]:
    kind, _, rest = name.partition("://")
    host, _, both = rest.rpartition(":")
    left, comma, right = (both if kind == "dv" else rest).partition(",")
    if not (comma and left and right):
        raise InputError(f"{name}: names no two cameras; give one of {SOURCES}")
    if kind == "dv-camera":
        return partial(open_dv_camera, left), partial(open_dv_camera, right)
    if kind == "usb":
        return partial(open_usb_camera, left), partial(open_usb_camera, right)
    if kind == "dv" and host and left.isdigit() and right.isdigit():
        return partial(open_dv_network, host, int(left)), partial(open_dv_network, host, int(right))
    raise InputError(f"{name}: is none of {SOURCES}")


def _checked(
    opened: Callable[[], CameraStream], resolution: tuple[int, int]
) -> Callable[[], CameraStream]:
    """Compare the resolution that a stream states with the calibrated one."""

    def open_checked() -> CameraStream:
        stream = opened()
        if isinstance(stream, DvStream):
            check_resolution(stream.resolution, resolution, "the stream")
        return stream

    return open_checked
