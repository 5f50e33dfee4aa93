"""What cameras send wrongly is repaired, counted and said; what is right is left as it is."""

from __future__ import annotations

import logging
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpvo.live import LiveOdometry
from gpvo.live.repair import Repair
from gpvo.live.session import Intake, LiveSession
from gpvo.live.sources import Packet
from gpvo.recordings.checks.first_faulty import first_faulty
from gpvo.recordings.streams import EventBlock
from gpvo.simulation import SimulationConfig

RIG = SimulationConfig(resolution=(64, 48)).rig


def block(t_us: np.ndarray, x: int = 5) -> EventBlock:
    count = len(t_us)
    column = np.full(count, x, np.uint16)
    return EventBlock(column, column, t_us.astype(np.int64) * 1000, np.ones(count, bool))


def steady(begin_us: int, packets: int = 20, offset_us: int = 0, arrival: float = 100.0):
    """Return packets of 5 ms, 100 events of each camera, the right one's clock ahead."""
    for index in range(packets):
        t = begin_us + 5000 * index + 50 * np.arange(100)
        yield Packet(block(t), block(t + offset_us), arrival + 0.005 * (index + 1))


def repaired(packets) -> tuple[Repair, list[tuple[EventBlock, EventBlock, bool]]]:
    repair = Repair(RIG)
    return repair, [repair(packet) for packet in packets]


@given(st.lists(st.tuples(st.integers(0, 70), st.integers(0, 50), st.integers(-2, 9)), max_size=6))
def test_a_block_is_faultless_if_nothing_of_it_is_to_be_repaired(
    events: list[tuple[int, int, int]],
) -> None:
    x, y, steps = np.array(events, np.int64).reshape(-1, 3).T
    t, (width, height) = np.cumsum(steps), RIG.left.resolution
    expected = (x < width).all() and (y < height).all() and (steps >= 0).all()
    pixels = x.astype(np.uint16), y.astype(np.uint16)
    assert (first_faulty(*pixels, t, RIG.left, 0) is None) == expected


def test_a_good_stream_is_left_as_it_is(caplog: pytest.LogCaptureFixture) -> None:
    packets = list(steady(10**9))
    with caplog.at_level(logging.WARNING):
        repair, found = repaired(packets)
    for packet, (left, right, is_gap) in zip(packets, found, strict=True):
        assert not is_gap
        np.testing.assert_array_equal(left.t_ns, packet.left.t_ns)
        np.testing.assert_array_equal(right.t_ns, packet.right.t_ns)
    assert not repair.faults and not caplog.messages


@pytest.mark.parametrize("jump_s", [-500.0, -1.0, 3600.0])
def test_time_goes_on_after_a_jump(jump_s: float, caplog: pytest.LogCaptureFixture) -> None:
    before = list(steady(10**9))
    after = list(steady(10**9 + round(1e6 * jump_s) + 100_000, arrival=before[-1].arrival))
    with caplog.at_level(logging.WARNING):
        _, found = repaired([*before, *after])
    assert [index for index, (_, _, is_gap) in enumerate(found) if is_gap] == [20]
    for side in (0, 1):
        t_ns = np.concatenate([each[side].t_ns for each in found])
        assert len(t_ns) == 4000 and (np.diff(t_ns) >= 0).all()
        assert np.ptp(t_ns) == pytest.approx(0.2e9, abs=0.01e9)
    assert found[25][0].t_ns[0] == found[25][1].t_ns[0]
    assert len(caplog.messages) == 2 and "clock jumped by" in caplog.messages[0]


def test_small_disorder_is_sorted_and_what_lies_outside_is_left_out() -> None:
    t = np.arange(0, 5000, 50)
    swapped = t.copy()
    swapped[[10, 20]] = t[[20, 10]]
    outside = EventBlock.concatenate([block(t), block(t[-1:], x=65535)])
    repair, found = repaired([Packet(block(swapped), outside, 1.0)])
    np.testing.assert_array_equal(found[0][0].t_ns, 1000 * t)
    np.testing.assert_array_equal(found[0][1].t_ns, 1000 * t)
    assert repair.faults["events outside the sensor were left out"] == 1
    assert sum(count for kind, count in repair.faults.items() if "sorted" in kind) > 0


def test_damaged_stamps_within_a_packet_are_left_out() -> None:
    t = np.arange(0, 5000, 50)
    t[50] = 2**50
    _, found = repaired([Packet(block(t), EventBlock.empty(), 1.0)])
    t_us = found[0][0].t_ns // 1000
    assert len(t_us) >= 49 and (t_us < 5000).all()


def test_unsynchronised_clocks_are_aligned_and_said(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        _, found = repaired(steady(10**9, offset_us=7_000_000))
    assert all(left.t_ns[0] == right.t_ns[0] for left, right, _ in found)
    assert ["not synchronised" in message for message in caplog.messages] == [True]
    assert "+7.000 s ahead" in caplog.messages[0]


def test_a_given_offset_is_left_to_the_odometry(caplog: pytest.LogCaptureFixture) -> None:
    packets, repair = list(steady(10**9, offset_us=300_000)), Repair(RIG, right_offset=0.31)
    with caplog.at_level(logging.WARNING):
        found = [repair(packet) for packet in packets]
    for packet, (_, right, _) in zip(packets, found, strict=True):
        np.testing.assert_array_equal(right.t_ns, packet.right.t_ns)
    assert not caplog.messages


def test_how_a_recording_is_played_tells_nothing_of_its_clocks(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """At a tenth of its speed a camera that begins later arrives much later."""
    played = [
        replace(packet, arrival=100 + index * 0.05, is_played=True)
        for index, packet in enumerate(steady(10**9))
    ]
    begin_later = [replace(packet, right=EventBlock.empty()) for packet in played[:6]]
    with caplog.at_level(logging.WARNING):
        _, found = repaired([*begin_later, *played[6:]])
    for packet, (_, right, _) in zip(played[6:], found[6:], strict=True):
        np.testing.assert_array_equal(right.t_ns, packet.right.t_ns)
    assert not caplog.messages


def test_drift_of_the_clocks_is_said(caplog: pytest.LogCaptureFixture) -> None:
    packets = []
    for index in range(2000):
        t = np.array([5000 * index, 5000 * index + 4000])
        drifted = (t * 1.004).astype(np.int64)
        packets.append(Packet(block(t), block(drifted), 100 + 0.005 * (index + 1)))
    with caplog.at_level(logging.WARNING):
        repaired(packets)
    drifts = [message for message in caplog.messages if "clocks drift" in message]
    assert drifts and all("gained +" in message for message in drifts)


class Broken:
    """Source that fails, or goes on after a gap."""

    def __init__(self, packets, error: Exception | None = None) -> None:
        self._packets, self._error, self.closed = packets, error, False

    def packets(self):
        yield from self._packets
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        self.closed = True


def test_a_failing_source_ends_the_session_with_its_error() -> None:
    source = Broken(steady(10**9), RuntimeError("unplugged"))
    with pytest.raises(RuntimeError, match="unplugged"):
        LiveSession(LiveOdometry(RIG), RIG, source).run()
    assert source.closed


def test_time_after_a_gap_is_not_taken_for_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gpvo.live.session.LONGEST", 60.0)  # whatever else the computer does
    now = time.perf_counter()
    before = list(steady(10**9, arrival=now))
    first, *rest = steady(10**9 + 2_000_000, arrival=now)
    gap = Packet(first.left, first.right, first.arrival, after_gap=True)
    live = LiveOdometry(RIG)
    LiveSession(live, RIG, Broken([*before, gap, *rest])).run()
    assert live.close() is None
    assert all(report.stop < 0.11 or report.start > 1.99 for report in live.reports)
    assert gap.left.t_ns[0] == (10**9 + 2_000_000) * 1000


def test_too_much_that_waits_is_thrown_away_as_a_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gpvo.live.session.MOST_WAITING", 500)
    intake = Intake(Broken(list(steady(10**9))))
    while not intake._at_end:
        time.sleep(0.001)
    left = intake.take_all()
    assert intake.discarded + sum(map(len, left)) == 20 * 200
    assert intake.discarded > 0 and sum(map(len, left)) <= 500
    assert [packet.after_gap for packet in left] == [True] + [False] * (len(left) - 1)
