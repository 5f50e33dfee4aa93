"""Placeholder for the rig of uncalibrated cameras, so that their events can be read."""

from __future__ import annotations

import numpy as np

from gpvo.recordings.calibration.fields import LARGEST_SIDE
from gpvo.recordings.calibration.rig import Camera, StereoRig

LARGEST = (LARGEST_SIDE, LARGEST_SIDE)
"""Largest resolution of uint16 pixels; 65535 marks an invalid pixel."""

_CAMERA = Camera(LARGEST, np.array([1.0, 1.0, 0.0, 0.0]), "none", np.zeros(4), np.eye(3))

UNKNOWN_RIG = StereoRig(_CAMERA, _CAMERA, 1.0, (0.0, 0.0), 1.0)
