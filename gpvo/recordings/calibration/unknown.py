"""A stand-in for the rig of cameras that nobody has calibrated: lets their events be looked at."""

from __future__ import annotations

import numpy as np

from gpvo.recordings.calibration.rig import Camera, StereoRig

LARGEST = (65535, 65535)
"""Every pixel that uint16 can name lies on this sensor."""

_CAMERA = Camera(LARGEST, np.array([1.0, 1.0, 0.0, 0.0]), "none", np.zeros(4), np.eye(3))

UNKNOWN_RIG = StereoRig(_CAMERA, _CAMERA, 1.0, (0.0, 0.0), 1.0)
