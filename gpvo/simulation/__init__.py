"""Simulated stereo event recordings with exact ground truth: see `recording.simulate`."""

from gpvo.simulation.recording import SimulatedRecording, SimulationConfig, simulate

__all__ = [
    "SimulatedRecording",
    "SimulationConfig",
    "simulate",
]
