"""Sources of live events: recordings at their own pace, the network, and cameras that fail."""

from __future__ import annotations

import logging
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gpvo import Configuration, InputError, LiveOdometry, Odometry
from gpvo.live.load import WIDEST, Level
from gpvo.live.session import LiveSession
from gpvo.live.sources import RecordingPlayer, open_cameras
from gpvo.live.sources import two_cameras as two_cameras_module
from gpvo.live.sources.two_cameras import TwoCameras
from gpvo.live.sources.usb import UsbCamera
from gpvo.recordings import Events
from gpvo.recordings.streams import EventBlock
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate

CONFIG = Configuration.model_validate({"tracking": {"klt": {"max_features": 40}}})


@pytest.fixture(scope="module")
def room() -> SimulatedRecording:
    config = SimulationConfig(seed=2, duration=0.4, resolution=(160, 120), focal_length=105.0)
    return simulate(config)


def test_a_recording_is_played_at_its_pace_and_estimated_as_a_file(
    room: SimulatedRecording,
) -> None:
    began = time.perf_counter()
    packets = list(RecordingPlayer(room, speed=2.0).packets())
    assert time.perf_counter() - began >= room.duration / 2
    assert np.ptp([each.arrival for each in packets]) == pytest.approx(room.duration / 2, abs=0.02)
    for name in ("left", "right"):
        t_ns = np.concatenate([getattr(each, name).t_ns for each in packets])
        expected = room.start_ns + np.rint(getattr(room, name).t * 1e9).astype(np.int64)
        np.testing.assert_array_equal(t_ns, expected)


def test_with_time_enough_nothing_is_shed(
    room: SimulatedRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    for limit in ("OLD", "BUSY", "LATE"):  # whatever else the computer does
        monkeypatch.setattr(f"gpvo.live.load.{limit}", 60.0)
    monkeypatch.setattr("gpvo.live.session.LONGEST", 60.0)
    live = LiveOdometry(room.rig, CONFIG)
    session = LiveSession(live, room.rig, RecordingPlayer(room, speed=1.0))
    session.run()
    found, expected = live.close(), Odometry(room.rig, CONFIG).run(room)
    assert session.load.worst == Level() and not session.faults
    np.testing.assert_array_equal(found.T_world_cam, expected.T_world_cam)
    assert len(session.latency.seconds) > 2
    assert min(session.latency.seconds) > 0


def test_what_is_left_out_between_clusters_is_counted_and_no_fault(
    room: SimulatedRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gpvo.live.load.BUSY", 1e-6)  # it never has time
    monkeypatch.setattr("gpvo.live.session.LONGEST", 60.0)
    live = LiveOdometry(room.rig, CONFIG)
    session = LiveSession(live, room.rig, RecordingPlayer(room, speed=0.2))
    session.run()
    assert live.close() is not None
    assert session.load.worst.spacing == WIDEST and session.load.discarded == 0
    used, given = sum(report.events for report in live.reports), len(room.left) + len(room.right)
    assert session.load.left_out > 0.2 * given
    # The last events fill no cluster.
    assert 0.6 * given < used + session.load.left_out <= given
    assert not any(fault.kind == "no events" for fault in live.odometry.faults)


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_a_source_that_is_too_fast_is_survived(room: SimulatedRecording, speed: float) -> None:
    """Estimating takes so long that the source is faster at every speed."""
    live = LiveOdometry(room.rig, CONFIG, observer=lambda _: time.sleep(0.4))
    session = LiveSession(live, room.rig, RecordingPlayer(room, speed))
    session.run()
    trajectory = live.close()
    events = sum(report.events for report in live.reports)
    given = len(room.left) + len(room.right)
    assert events + session.load.left_out + session.load.discarded <= given
    if speed >= 4:
        assert session.load.discarded > 0
    if trajectory is not None:
        assert np.isfinite(trajectory.T_world_cam).all()
        assert (np.linalg.eigvalsh(live.latest().covariance) > 0).all()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def columns(events: Events) -> np.ndarray:
    t_us = np.rint(events.t * 1e6).astype(np.int64)
    return np.column_stack([events.x, events.y, t_us, events.polarity])


def test_the_network_stream_is_that_of_dv_processing(
    room: SimulatedRecording, tmp_path: Path
) -> None:
    pytest.importorskip("dv_processing")
    file = tmp_path / "events.npz"
    np.savez(file, left=columns(room.left), right=columns(room.right), size=room.rig.resolution)
    ports = free_port(), free_port()
    sender = Path(__file__).with_name("dv_sender.py")
    command = [sys.executable, sender, *map(str, ports), file]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None and process.stdout.readline() == b"ready\n"
        source = open_cameras("dv://127.0.0.1:{},{}".format(*ports), room.rig)
        got: dict[str, list[EventBlock]] = {"left": [], "right": []}
        wanted, deadline = len(room.left) + len(room.right), time.perf_counter() + 20
        for packet in source.packets():
            got["left"].append(packet.left)
            got["right"].append(packet.right)
            if sum(map(len, got["left"] + got["right"])) >= wanted:
                break
            assert time.perf_counter() < deadline
        source.close()
    finally:
        process.kill()
        process.wait()
    for name, parts in got.items():
        block, events = EventBlock.concatenate(parts), getattr(room, name)
        np.testing.assert_array_equal(block.t_ns // 1000 - 10**15, columns(events)[:, 2])
        np.testing.assert_array_equal(block.x, events.x)
        np.testing.assert_array_equal(block.y, events.y)
        np.testing.assert_array_equal(block.polarity, events.polarity)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("dv://127.0.0.1:1,2", "no connection .*Connection refused.*Network output"),
        ("dv://127.0.0.1:7777", "names no two cameras"),
        ("dv://7777,7778", "is none of"),
        ("ftp://1,2", "is none of dv://"),
        ("usb://0000,1111", "usb camera 0000: cannot be opened .*udev"),
        ("dv-camera://0000,1111", "dv-camera 0000: cannot be opened .*Could not find device"),
    ],
)
def test_cameras_that_are_not_there_are_one_clear_line(
    room: SimulatedRecording, name: str, message: str
) -> None:
    for module in ("dv_processing", "neuromorphic_drivers"):
        pytest.importorskip(module)
    with pytest.raises(InputError, match=message) as raised:
        open_cameras(name, room.rig)
    assert "\n" not in str(raised.value)


class Scripted:
    """Camera that gives blocks, None where it is gone."""

    def __init__(self, script: list[EventBlock | None]) -> None:
        self._script = script

    def read(self) -> EventBlock | None:
        return self._script.pop(0) if self._script else EventBlock.empty()

    def close(self) -> None:
        pass


def one_event(t_us: int) -> EventBlock:
    return EventBlock(
        np.zeros(1, np.uint16), np.zeros(1, np.uint16), np.array([1000 * t_us]), np.ones(1, bool)
    )


def test_a_camera_that_drops_out_is_opened_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(two_cameras_module, "SILENCE", 0.02)
    monkeypatch.setattr(two_cameras_module, "RETRY", 0.01)
    opened: list[str] = []

    def open_left() -> Scripted:
        opened.append("left")
        if len(opened) in (2, 3):
            raise InputError("still unplugged")
        return Scripted([one_event(1), None] if len(opened) == 1 else [one_event(2)])

    source = TwoCameras(open_left, lambda: Scripted([]))
    with caplog.at_level(logging.WARNING, logger="gpvo.live"):
        seen = []
        for packet in source.packets():
            if len(packet):
                seen.append(packet)
            if len(seen) == 2:
                source.close()
    assert [packet.left.t_ns[0] for packet in seen] == [1000, 2000]
    assert [packet.after_gap for packet in seen] == [False, True]
    text = "\n".join(caplog.messages)
    assert "the left camera is gone" in text and "the left camera is back" in text
    assert "no events for" in text and "events are back after" in text


class Device:
    """Stand-in for neuromorphic-drivers' device, with its event type."""

    def __init__(self, packets: list[np.ndarray | None]) -> None:
        self._packets = packets

    def __next__(self) -> tuple[object, object]:
        if not self._packets:
            raise RuntimeError("device disconnected")
        events = self._packets.pop(0)
        return None, None if events is None else type("", (), {"polarity_events": events})


def test_usb_events_are_read_as_the_driver_gives_them() -> None:
    kind = [("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")]
    camera = UsbCamera(Device([np.array([(7, 1, 2, True), (9, 3, 4, False)], kind), None]))
    block = camera.read()
    assert block.t_ns.tolist() == [7000, 9000] and block.x.tolist() == [1, 3]
    assert block.y.tolist() == [2, 4] and block.polarity.tolist() == [True, False]
    assert len(camera.read()) == 0
    assert camera.read() is None
