"""Simulated stereo event recordings with exact ground truth: see `recording.simulate`."""

from gpvo.simulation.config import SimulationConfig
from gpvo.simulation.motion import Motion
from gpvo.simulation.recording import SimulatedRecording, simulate

__all__ = [
    "Motion",
    "SimulatedRecording",
    "SimulationConfig",
    "simulate",
]
