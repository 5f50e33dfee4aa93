"""Sources of live events: recordings that are played, network streams and cameras."""

from gpvo.live.sources.open_source import SOURCES, is_camera, open_cameras
from gpvo.live.sources.packet import Packet, Source
from gpvo.live.sources.recording_player import RecordingPlayer

__all__ = ["SOURCES", "Packet", "RecordingPlayer", "Source", "is_camera", "open_cameras"]
