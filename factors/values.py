"""What the kernels read from GTSAM's values."""

from __future__ import annotations

import gtsam
import numpy as np

from factors.kernels import Array

# Columns of a derivative by (T_i, v_i, T_j, v_j).
STATE_COLUMNS = [np.s_[:, 6 * block : 6 * block + 6] for block in range(4)]


def pose_matrix(values: gtsam.Values, key: int) -> Array:
    """(4, 4) matrix of a Pose3, its rows contiguous as the kernels want them."""
    matrix: Array = values.atPose3(key).matrix().copy()  # which is of C order by default
    return matrix
