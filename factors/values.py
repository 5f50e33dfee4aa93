"""What the kernels read from GTSAM's values."""

from __future__ import annotations

import gtsam
import numpy as np

from factors.kernels import Array


def pose_matrix(values: gtsam.Values, key: int) -> Array:
    """(4, 4) matrix of a Pose3, its rows contiguous as the kernels want them."""
    return np.ascontiguousarray(values.atPose3(key).matrix())
