"""Base of the writers of all formats, and the writer of the calibration beside them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gpvo.recordings.base import Events
from gpvo.recordings.calibration.rig import Camera, StereoRig
from gpvo.recordings.streams import EventBlock

Size = tuple[int, int]
Sizes = tuple[Size, ...]


class RecordingWriter(ABC):
    """Writer of a recording, batch by batch.

    Parameters
    ----------
    path
        File or folder; must not exist yet.
    sizes
        (width, height) of the left and the right sensor, or of the only one; zeros if unknown.
    start_ns
        Absolute stamp of the first event of either camera.
    """

    @abstractmethod
    def __init__(self, path: Path, sizes: Sizes, start_ns: int) -> None: ...

    @abstractmethod
    def append(self, *blocks: EventBlock) -> None:
        """Append each camera's events of one interval, later than all before."""

    @abstractmethod
    def close(self) -> None:
        """Finish the file."""

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def stamped(events: Events, start_ns: int) -> EventBlock:
    """Return the same events with absolute stamps."""
    t_ns = start_ns + np.rint(events.t * 1e9).astype(np.int64)
    return EventBlock(events.x, events.y, t_ns, events.polarity)


def microseconds(t_ns: np.ndarray) -> np.ndarray:
    """Return the nearest whole microseconds, int64."""
    return (t_ns + 500) // 1000


def write_camchain(path: Path, rig: StereoRig) -> None:
    """Write a rig as a kalibr camchain."""
    path.write_text(camchain_text(rig), encoding="utf-8")


def camchain_text(rig: StereoRig) -> str:
    """Return a rig as a kalibr camchain with MVSEC's rectification, as read_kalibr reads it."""
    R_left, R_right = rig.left.R_rect, rig.right.R_rect
    T_right_left = np.eye(4)
    T_right_left[:3, :3] = R_right.T @ R_left
    T_right_left[:3, 3] = R_right.T @ [-rig.baseline, 0.0, 0.0]
    content = {
        "cam0": _fields(rig, rig.left, 0.0),
        "cam1": _fields(rig, rig.right, rig.baseline) | {"T_cn_cnm1": T_right_left.tolist()},
    }
    return str(yaml.safe_dump(content, default_flow_style=None))


def _fields(rig: StereoRig, camera: Camera, x: float) -> dict[str, Any]:
    """Return the fields of a camera that is x metres to the right of the left one."""
    projection = np.column_stack([rig.K_rect, [-rig.focal_length * x, 0.0, 0.0]])
    return {
        "camera_model": "pinhole",
        "distortion_coeffs": camera.distortion.tolist(),
        "distortion_model": camera.distortion_model,
        "intrinsics": camera.intrinsics.tolist(),
        "projection_matrix": projection.tolist(),
        "rectification_matrix": camera.R_rect.tolist(),
        "resolution": list(camera.resolution),
    }
