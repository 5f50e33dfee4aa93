"""Recordings: one reader per format, all giving the same events in the same batches."""

from gpvo.recordings.base import Events, Recording, StereoEvents
from gpvo.recordings.calibration.find import read_calibration
from gpvo.recordings.calibration.kalibr import read_kalibr
from gpvo.recordings.calibration.rig import Camera, StereoRig
from gpvo.recordings.open_recording import open_recording

__all__ = [
    "Camera",
    "Events",
    "Recording",
    "StereoEvents",
    "StereoRig",
    "open_recording",
    "read_calibration",
    "read_kalibr",
]
