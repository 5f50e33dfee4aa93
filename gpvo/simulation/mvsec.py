"""Write a recording as MVSEC's files: events, ground truth and kalibr camchain."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import yaml
from numpy.typing import NDArray

from gpvo.recordings.base import Events
from gpvo.recordings.calibration.rig import StereoRig
from gpvo.trajectory.stamped_poses import StampedPoses


def write_mvsec(
    folder: Path,
    name: str,
    rig: StereoRig,
    start_ns: int,
    left: Events,
    right: Events,
    ground_truth: StampedPoses,
) -> None:
    """Write NAME_data.hdf5, NAME_gt.hdf5 and camchain-NAME.yaml into a folder.

    Parameters
    ----------
    rig
        An undistorted, rectified rig.
    start_ns
        Absolute stamp of the events' t = 0.
    ground_truth
        T_world_cam of the left camera.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with h5py.File(folder / f"{name}_data.hdf5", "w") as file:
        file["davis/left/events"] = _event_table(left, start_ns)
        file["davis/right/events"] = _event_table(right, start_ns)
    with h5py.File(folder / f"{name}_gt.hdf5", "w") as file:
        file["davis/left/pose"] = ground_truth.T_world_cam
        file["davis/left/pose_ts"] = ground_truth.stamps_ns * 1e-9
    camchain = yaml.safe_dump(_camchain(rig), default_flow_style=None, sort_keys=False)
    (folder / f"camchain-{name}.yaml").write_text(camchain, encoding="utf-8")


def _event_table(events: Events, start_ns: int) -> NDArray[np.float64]:
    """(N, 4) x, y, absolute seconds, polarity -1 or 1."""
    seconds = (start_ns + np.rint(events.t * 1e9)) / 1e9
    return np.column_stack([events.x, events.y, seconds, np.where(events.polarity, 1.0, -1.0)])


def _camchain(rig: StereoRig) -> dict[str, dict[str, object]]:
    """Fields of both cameras; T_cn_cnm1 takes points of the left camera to the right one."""
    T_right_left = np.eye(4)
    T_right_left[0, 3] = -rig.baseline
    left, right = _camera_fields(rig, 0.0), _camera_fields(rig, rig.baseline)
    return {"cam0": left, "cam1": right | {"T_cn_cnm1": T_right_left.tolist()}}


def _camera_fields(rig: StereoRig, x: float) -> dict[str, object]:
    """Fields of a camera that stands x metres right of the left one."""
    projection = np.column_stack([rig.K_rect, [-rig.focal_length * x, 0.0, 0.0]])
    return {
        "camera_model": "pinhole",
        "distortion_coeffs": [0.0] * 4,
        "distortion_model": "none",
        "intrinsics": rig.left.intrinsics.tolist(),
        "projection_matrix": projection.tolist(),
        "rectification_matrix": np.eye(3).tolist(),
        "resolution": list(rig.resolution),
    }
