"""Compile, or load what is compiled, before the first event: later it would cost their latency."""

from __future__ import annotations

from gpvo.config import Configuration
from gpvo.evaluation.report.compilation import CompilationTimer
from gpvo.live import LiveOdometry
from gpvo.live.raw_events import RawEvents
from gpvo.live.sources import RecordingPlayer
from gpvo.recordings.streams import EventBlock
from gpvo.simulation import SimulationConfig, simulate
from gpvo.warm_up.beside import CompileBeside

SIMULATED = SimulationConfig(duration=1.5, resolution=(120, 90), focal_length=80.0, noise_rate=2.0)
FEATURES = 60
"""Number of features, of which there are more: those that tell most of the pose are chosen."""
MISSING = slice(100, 220)
"""Packets that are left out, so that landmarks are lost and found again."""


def warm_up(configuration: Configuration) -> None:
    """Estimate a short simulated motion, and forget it."""
    with CompileBeside() as beside, CompilationTimer(beside.start):
        _estimate(configuration)


def _estimate(configuration: Configuration) -> None:
    recording = simulate(SIMULATED)
    live = LiveOdometry(recording.rig, _with_few_features(configuration))
    packets = list(RecordingPlayer(recording, speed=1e3).packets())
    del packets[MISSING]
    for packet in packets:
        live.push(_raw(packet.left), _raw(packet.right))
    live.close()
    newest = live.latest()
    if newest is not None:
        newest.at(newest.t + 0.1)


def _with_few_features(configuration: Configuration) -> Configuration:
    tracking = configuration.tracking
    klt = tracking.klt.model_copy(update={"max_features": FEATURES})
    return configuration.model_copy(update={"tracking": tracking.model_copy(update={"klt": klt})})


def _raw(block: EventBlock) -> RawEvents:
    return block.x, block.y, block.t_ns // 1000, block.polarity
