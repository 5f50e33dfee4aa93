"""Simulated stereo event recordings with exact ground truth: see `recording.simulate`."""
