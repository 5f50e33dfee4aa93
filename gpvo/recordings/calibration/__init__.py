"""The stereo rig, and readers of all kinds of calibration files."""
