"""Make a rectified rig from two calibrated cameras."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gpvo.recordings.calibration.fields import Fields
from gpvo.recordings.calibration.plausible import check_rig
from gpvo.recordings.calibration.rig import Camera, StereoRig

Pair = tuple[NDArray[np.float64], NDArray[np.float64]]

LONGEST = 10.0
"""Baseline beyond which lengths are not in metres, metres."""


def rectified_rig(
    left: Camera, right: Camera, T_right_left: NDArray[np.float64], fields: Fields, source: str
) -> StereoRig:
    """Return the rig with OpenCV's rectification, with zero disparity at infinity.

    Parameters
    ----------
    T_right_left
        (4, 4), takes points of the left camera to the right one.
    fields, source
        Place of the transform, for error messages.
    """
    R, t = T_right_left[:3, :3].copy(), T_right_left[:3, 3:].copy()
    fields.check_rotation(source, R)
    if not abs(t[0, 0]) > max(abs(t[1, 0]), abs(t[2, 0])):
        fields.fail(source, f"does not place the cameras side by side: it moves by {t[:, 0]} m")
    fisheye = left.distortion_model == "equidistant"
    if fisheye != (right.distortion_model == "equidistant"):
        fields.fail("distortion_model", "must be that of cam0, or give rectification matrices")
    rectify: Any = cv2.fisheye.stereoRectify if fisheye else cv2.stereoRectify
    R_left, R_right, P_left, P_right, *_ = rectify(
        *(left.K, left.distortion, right.K, right.distortion),
        *(left.resolution, R, t),
        flags=cv2.CALIB_ZERO_DISPARITY,
    )
    return projected_rig(left, right, (R_left, R_right), (P_left, P_right), fields, source)


def projected_rig(
    left: Camera, right: Camera, R_rect: Pair, P: Pair, fields: Fields, source: str
) -> StereoRig:
    """Return the rig with given rectifying rotations (3, 3) and projections (3, 4).

    `source` is the field that error messages about the projections name.
    """
    P_left, P_right = P
    f, cx, cy = (float(number) for number in (P_left[0, 0], P_left[0, 2], P_left[1, 2]))
    K_rect = np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])
    shared = np.allclose([P_left[:, :3], P_right[:, :3]], K_rect, rtol=0.0, atol=1e-3)
    if not (shared and f > 0.0):
        fields.fail(source, "does not give both cameras one focal length and principal point")
    if np.any(P_left[:, 3]) or abs(P_right[1, 3]) > 1e-6 * f:
        fields.fail(source, "does not place the cameras side by side")
    baseline = float(-P_right[0, 3] / f)
    if not 0.0 < baseline < np.inf:
        fields.fail(source, "gives no positive baseline; cam0 must be the left camera")
    if baseline > LONGEST:
        fields.fail(source, f"gives a baseline of {baseline:g} m: lengths must be in metres")
    left, right = replace(left, R_rect=R_rect[0]), replace(right, R_rect=R_rect[1])
    rig = StereoRig(left, right, f, (cx, cy), baseline)
    check_rig(rig, fields, source)
    return rig
