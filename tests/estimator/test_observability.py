"""Where the world is, and how it is turned, cannot be seen: it stays as uncertain as it was.

Inconsistent smoothers gain information in these six directions, as they linearise a landmark at one
estimate when it is marginalised and at another later.
"""

from __future__ import annotations

import numpy as np
import pytest
from runs import fed
from scipy.linalg import eigh
from synthetic import CAMERA
from test_loops import NOISE, two_rounds

from factors.lie import se3_adjoint, se3_inverse
from gpvo.config import EstimatorConfig
from gpvo.estimator import FixedLagSmoother, InitialState

DEVIATIONS = np.repeat([0.02, 0.05, 1.0], [3, 3, 6])
"""Of the first state: rad, m, rad/s and m/s. The path adds less."""


@pytest.mark.parametrize(("lost_landmarks", "gained"), [(0, 1e-6), (300, 0.03)])
def test_what_is_measured_tells_nothing_of_the_first_pose(
    lost_landmarks: int, gained: float
) -> None:
    """The covariance of every pose is the first one's, moved there, and more.

    What was lost and is known again is joined as if independent, which gains a little.
    """
    covariance = np.diag(DEVIATIONS**2)
    initial = InitialState(np.eye(4), np.zeros(6), covariance)
    config = EstimatorConfig(lost_landmarks=lost_landmarks)
    trajectory = fed(FixedLagSmoother(CAMERA, NOISE, config, initial), two_rounds(0))
    t = np.linspace(trajectory.t[0], trajectory.t[-1], 20)
    T_first_cam = se3_inverse(trajectory.pose(t[0])) @ trajectory.pose(t)
    for T, known in zip(T_first_cam, trajectory.covariance(t), strict=True):
        moved = se3_adjoint(se3_inverse(T))
        least = moved @ covariance[:6, :6] @ moved.T
        assert eigh(known[:6, :6], least, eigvals_only=True)[0] > 1.0 - gained
