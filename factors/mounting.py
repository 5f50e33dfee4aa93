"""A camera that a body carries at T_body_cam, or that is the body."""

from __future__ import annotations

import numpy as np

from factors.checks import Pose, checked_pose
from factors.kernels.se3 import Array
from factors.lie import se3_adjoint, se3_inverse


def checked_mounting(T_body_cam: Pose | None) -> Array | None:
    """Return the pose (4, 4) of a camera in its body; None if they are the same."""
    return None if T_body_cam is None else checked_pose("T_body_cam", T_body_cam)


def camera_by_body(T_body_cam: Array | None) -> Array:
    """Compute the Jacobian (6, 6) of the camera's pose, or twist, with respect to the body's."""
    return np.eye(6) if T_body_cam is None else se3_adjoint(se3_inverse(T_body_cam))
