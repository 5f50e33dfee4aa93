"""Refuse rectifications after which two cameras see nothing of one scene."""

from __future__ import annotations

import numpy as np

from gpvo.recordings.calibration.fields import SHORTEST_FOCAL, Fields
from gpvo.recordings.calibration.rig import Camera, StereoRig

MOST_TURNED = 40.0
"""Angle between the axes of a lens and of its rectified picture, degrees."""
LEAST_VIEW = 0.1
"""Share of a camera's pixels that have to be in the rectified picture."""
GRID = 20
"""Pixels along each side at which that is tried."""


def check_rig(rig: StereoRig, fields: Fields, source: str) -> None:
    """Raise InputError unless both cameras look the same way and see the rectified picture.

    `source` is the field that says how the cameras are placed.
    """
    for side, camera in (("left", rig.left), ("right", rig.right)):
        turned = np.degrees(np.arccos(np.clip(camera.R_rect[2, 2], -1.0, 1.0)))
        if turned > MOST_TURNED:
            problem = f"turns the {side} camera by {turned:.0f} degrees to rectify it"
            fields.fail(source, f"{problem}; both must look the same way")
        if (share := view(camera, rig)) < LEAST_VIEW:
            problem = f"leaves {100 * share:.0f} % of the {side} camera's pixels in the picture"
            fields.fail(source, f"{problem}; is it that of these cameras?")
    if rig.focal_length < SHORTEST_FOCAL * max(rig.resolution):
        fields.fail(source, f"gives a focal length of {rig.focal_length:g} pixels; calibrate again")


def view(camera: Camera, rig: StereoRig) -> float:
    """Return the share of a camera's pixels that are in the rectified picture."""
    columns, rows = (np.linspace(0, side - 1, GRID) for side in camera.resolution)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    rectified = camera.rectify_points(pixels, rig.K_rect)
    inside = ((rectified >= 0) & (rectified <= np.array(rig.resolution) - 1)).all(axis=1)
    return float(inside.mean())
