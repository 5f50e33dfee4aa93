"""The stereo rig, and the calibration files of all kinds that it is read from."""
