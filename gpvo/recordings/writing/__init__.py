"""Recordings written in the formats that are read, and the calibration beside them."""
