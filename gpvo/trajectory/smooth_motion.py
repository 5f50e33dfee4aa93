"""How certain a velocity is if the motion is smoother than the prior expects.

The WNOA prior of density q and poses of noise density r make a smoother that passes the share
H = 1 / (1 + x^4) of a motion of angular frequency w, where x = w (r / q)^(1/4). The posterior
variance of the velocity is the integral of r w^2 H. Of it that of r w^2 H^2, a quarter, is what
noise of the measurements makes. The rest is motion too fast to be followed, which white noise has
and a hand, a car or a drone has not. (Of a pose three quarters are noise.)

A change of the acceleration shows in later states: where there are none it is not followed either.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LONG = 3.0
"""Number of usual times between knots from which on there are no states near."""


def velocity_scale(knot_t: Array, share: float) -> Array:
    """Return by what (M,) velocities' standard deviations are multiplied at times (M,), seconds.

    It is the root of the share amid other knots, and 1 at the ends, beside long gaps, and at the
    knots next to these.
    """
    dt = np.diff(knot_t)
    if len(dt) == 0:
        return np.ones(len(knot_t))
    is_long = np.concatenate([[True], dt > LONG * np.median(dt), [True]])
    alone = is_long[:-1] | is_long[1:]
    near = alone | np.append(alone[1:], False) | np.append(False, alone[:-1])
    return np.where(near, 1.0, np.sqrt(share))
