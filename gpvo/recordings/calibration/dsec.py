"""Read DSEC's cam_to_cam.yaml: cam0 and cam3 are the left and right event cameras."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.recordings.calibration.fields import Fields
from gpvo.recordings.calibration.rectification import projected_rig
from gpvo.recordings.calibration.rig import StereoRig


def dsec_rig(fields: Fields) -> StereoRig:
    """Return the rig of both event cameras, with DSEC's own rectification."""
    intrinsics, extrinsics = fields.mapping("intrinsics"), fields.mapping("extrinsics")
    left, right = (intrinsics.mapping(name).camera("camera_matrix") for name in ("cam0", "cam3"))
    R_rect = extrinsics.rotation("R_rect0"), extrinsics.rotation("R_rect3")
    fx, fy, cx, cy = intrinsics.mapping("camRect0").intrinsics("camera_matrix")
    # As in OpenCV, T_10 takes points of camera 0 to camera 1.
    T_30 = (
        extrinsics.transform("T_32") @ extrinsics.transform("T_21") @ extrinsics.transform("T_10")
    )
    # In the rectified right camera the left one's centre lies at (-baseline, 0, 0).
    t_rect = R_rect[1] @ T_30[:3, 3]
    if np.hypot(t_rect[1], t_rect[2]) > 0.01 * abs(t_rect[0]):
        extrinsics.fail("R_rect3", "does not turn the right camera beside the left one")
    P = _projection(fx, fy, cx, cy, 0.0), _projection(fx, fy, cx, cy, fx * float(t_rect[0]))
    return projected_rig(left, right, R_rect, P, extrinsics, "T_10, T_21, T_32")


def lidar_to_left(cam_to_cam: Fields, cam_to_lidar: Fields) -> NDArray[np.float64]:
    """Return T_lidar_left (4, 4) from the rectified left event camera to the lidar.

    The transform in cam_to_lidar.yaml is that of the rectified frame camera, cam1.
    """
    extrinsics = cam_to_cam.mapping("extrinsics")
    R_rect0, R_rect1 = np.eye(4), np.eye(4)
    R_rect0[:3, :3] = extrinsics.rotation("R_rect0")
    R_rect1[:3, :3] = extrinsics.rotation("R_rect1")
    T_lidar_camrect1 = cam_to_lidar.transform("T_lidar_camRect1")
    return T_lidar_camrect1 @ R_rect1 @ extrinsics.transform("T_10") @ R_rect0.T


def _projection(fx: float, fy: float, cx: float, cy: float, offset: float) -> NDArray[np.float64]:
    return np.array([[fx, 0.0, cx, offset], [0.0, fy, cy, 0.0], [0.0, 0.0, 1.0, 0.0]])
