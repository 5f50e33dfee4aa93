"""Events that are pushed give the states of a recording's, bit for bit, however they are cut."""

from __future__ import annotations

import logging
import runpy
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from threading import Event, get_ident

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo import Configuration, InputError, LiveOdometry, Odometry, Trajectory
from gpvo.cluster_report import ClusterReport
from gpvo.live import RawEvents
from gpvo.observer import Step
from gpvo.recordings import Events, StereoEvents
from gpvo.recordings.right_offset import ShiftedRecording
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate

CONFIG = Configuration.model_validate({"tracking": {"klt": {"max_features": 40}}})


@cache
def room() -> SimulatedRecording:
    config = SimulationConfig(
        seed=2, duration=0.5, resolution=(240, 180), focal_length=160.0, noise_rate=2.0
    )
    return simulate(config)


def raw(events: Events) -> RawEvents:
    """Return events as a camera gives them, with absolute stamps."""
    t = room().start_ns // 1000 + np.rint(events.t * 1e6).astype(np.int64)
    return events.x, events.y, t, events.polarity


@cache
def whole() -> tuple[Trajectory, list[ClusterReport]]:
    odometry = Odometry(room().rig, CONFIG)
    return odometry.run(room()), odometry.reports


def pushed(cuts: list[float], lag: float, live: LiveOdometry) -> Trajectory | None:
    """Push events up to each cut, the right ones `lag` seconds later."""
    before = -1.0
    for cut in [*sorted(cuts), 1.0, 2.0]:
        left = room().left.between(before, cut)
        right = room().right.between(before - lag, cut - lag)
        live.push(raw(left), raw(right))
        before = cut
    return live.close()


@given(st.lists(st.floats(0, 0.6), max_size=40), st.floats(0, 0.3))
@settings(deadline=None, max_examples=6)
def test_states_are_those_of_the_recording(cuts: list[float], lag: float) -> None:
    trajectory, reports = whole()
    live = LiveOdometry(room().rig, CONFIG)
    found = pushed(cuts, lag, live)
    assert live.reports == reports and live.late == 0
    assert found is not None and found.start_ns == room().start_ns
    for name in ("t", "T_world_cam", "twist", "knots", "knot_covariance"):
        np.testing.assert_array_equal(getattr(found, name), getattr(trajectory, name))


def test_small_pushes_are_gathered_until_a_cluster_may_be_complete(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each batch costs time, however few events are in it."""
    live, batches, push = LiveOdometry(room().rig, CONFIG), [], Odometry.push

    def counted(odometry: Odometry, batch: StereoEvents) -> Iterator[ClusterReport]:
        batches.append(batch)
        return push(odometry, batch)

    monkeypatch.setattr(Odometry, "push", counted)
    pushed(list(np.arange(0, 0.5, 0.001)), 0.0, live)
    assert len(live.reports) <= len(batches) < 3 * len(live.reports)


def late_room(late: float) -> SimulatedRecording:
    """Return the room with a right camera whose stamps are late, to the microsecond."""
    left, right = room().left, replace(room().right, t=room().right.t + late)
    first = min(left.t[0], right.t[0])
    sides = [replace(side, t=np.round(side.t - first, 6)) for side in (left, right)]
    duration = float(max(side.t[-1] for side in sides))
    return replace(room(), left=sides[0], right=sides[1], duration=duration)


@pytest.mark.parametrize("late", [0.03, -0.03, 0.0000007])
@pytest.mark.parametrize("length", [0.007, 0.1])
def test_a_right_camera_that_is_late_is_corrected_as_in_a_recording(
    late: float, length: float
) -> None:
    recording = late_room(late)
    odometry = Odometry(recording.rig, CONFIG)
    expected = odometry.run(ShiftedRecording(recording, late))
    live = LiveOdometry(recording.rig, CONFIG, right_offset=late)
    for start in np.arange(0, 0.6, length):
        sides = (side.between(start, start + length) for side in (recording.left, recording.right))
        live.push(*(raw(side) for side in sides))
    found = live.close()
    assert live.reports == odometry.reports and live.late == 0
    for name in ("t", "T_world_cam", "twist", "knots", "knot_covariance"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.parametrize("method", ["fixed_lag", "batch"])
def test_latest_is_the_end_of_the_trajectory_so_far(method: str) -> None:
    config = CONFIG.model_copy(
        update={"estimator": CONFIG.estimator.model_copy(update={"method": method})}
    )
    live = LiveOdometry(room().rig, config)
    assert live.latest() is None and live.trajectory() is None
    compared = 0
    for start in np.arange(0, 0.3, 0.03):
        sides = (side.between(start, start + 0.03) for side in (room().left, room().right))
        live.push(*map(raw, sides))
        trajectory, latest = live.trajectory(), live.latest()
        if trajectory is None or latest is None:
            continue
        compared += 1
        assert latest.t == trajectory.stop <= live.reports[-1].stop
        ahead = live.latest(latest.t + 0.02)
        for estimate in (latest, ahead):
            pose = trajectory.pose(estimate.t, extrapolation=True)
            np.testing.assert_allclose(estimate.T_world_cam, pose, atol=1e-12)
            covariance = trajectory.covariance(estimate.t, extrapolation=True)
            np.testing.assert_allclose(estimate.covariance, covariance, rtol=1e-6, atol=1e-15)
        assert (np.diag(ahead.covariance) > np.diag(latest.covariance)).all()
    assert compared > 3


def test_latest_after_a_break_is_uncertain_by_the_break_too() -> None:
    live = LiveOdometry(room().rig, CONFIG)
    for start, shift_us in ((0.0, 0), (0.2, 3_000_000)):
        sides = (raw(side.between(start, start + 0.2)) for side in (room().left, room().right))
        live.push(*((x, y, t + shift_us, polarity) for x, y, t, polarity in sides))
        live.interrupted()
    trajectory, latest = live.close(), live.latest()
    assert trajectory is not None and latest is not None
    covariance = trajectory.covariance(latest.t)
    np.testing.assert_allclose(latest.covariance, covariance, rtol=1e-6, atol=1e-15)
    assert np.sqrt(covariance[3:6, 3:6].max()) > 0.02


@pytest.mark.parametrize("late", [np.nan, np.inf])
def test_an_offset_that_is_none_is_refused(late: float) -> None:
    with pytest.raises(InputError, match=r"right_offset: .* must be a number of seconds"):
        LiveOdometry(room().rig, CONFIG, right_offset=late)


@pytest.mark.parametrize("late", [0.8, -0.8])
def test_a_camera_that_is_late_is_not_silent(late: float, caplog: pytest.LogCaptureFixture) -> None:
    """Both are alive, although the offset is longer than the patience."""
    live = LiveOdometry(room().rig, CONFIG, patience=0.1, right_offset=late)
    with caplog.at_level(logging.WARNING, logger="gpvo.live"):
        for start in np.arange(0.0, 0.5, 0.02):
            sides = (side.between(start, start + 0.02) for side in (room().left, room().right))
            live.push(*map(raw, sides))
    assert not any("going on without" in message for message in caplog.messages)


def test_a_silent_camera_is_not_waited_for_and_late_events_are_counted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    live = LiveOdometry(room().rig, CONFIG, patience=0.1)
    with caplog.at_level(logging.WARNING, logger="gpvo.live"):
        live.push(raw(room().left.between(0, 0.4)))
        live.settle()
        assert live.reports[-1].stop > 0.25
        assert live.reports[-1].right_events == 0
        live.push(right=raw(room().right.between(0, 0.4)))
    said = [message for message in caplog.messages if "right camera" in message]
    assert ["going on without" in one for one in said] == [True, False]
    newest = np.max(raw(room().left.between(0, 0.4))[2])
    assert live.late == (raw(room().right.between(0, 0.4))[2] < newest - 100_000).sum() > 0


def test_an_interruption_is_not_taken_for_rest() -> None:
    live = LiveOdometry(room().rig, CONFIG)
    for start, stop in ((0.0, 0.2), (0.4, 0.5)):
        live.push(*(raw(side.between(start, stop)) for side in (room().left, room().right)))
        live.interrupted()
    assert all(report.stop <= 0.2 or report.start >= 0.399 for report in live.reports)
    assert not any(report.at_rest for report in live.reports)
    assert live.close() is not None


@pytest.mark.parametrize("on_purpose", [True, False])
def test_what_was_left_out_on_purpose_is_no_fault(on_purpose: bool) -> None:
    live = LiveOdometry(room().rig, CONFIG)
    for start, stop in ((0.0, 0.15), (0.4, 0.5)):
        live.push(*(raw(side.between(start, stop)) for side in (room().left, room().right)))
        live.interrupted(on_purpose)
    live.close()
    assert ["no events"] * (not on_purpose) == [fault.kind for fault in live.odometry.faults]


GOOD = (np.array([1, 2]), np.array([3, 4]), np.array([1000, 1001]), np.array([True, False]))


def bad(index: int, column: object) -> tuple:
    return tuple(column if i == index else each for i, each in enumerate(GOOD))


@pytest.mark.parametrize(
    ("events", "message"),
    [
        (bad(0, np.array([65535, 2])), "left x: 65535 at event 0 is not from 0 to 239"),
        (bad(1, np.array([3, -1])), "left y: -1 at event 1 is not from 0 to 179"),
        (bad(0, np.array([1.0, 2.0])), "left x: must be whole numbers"),
        (bad(2, np.array([1e3, 1e3])), "left t: must be whole numbers"),
        (bad(2, np.array([1001, 1000])), "left t: goes back by 1 us at event 1"),
        (bad(2, np.array([1, 2**62])), "too large for microseconds"),
        (bad(2, np.array([-(2**53), 1])), "-9007199254740992 is too large for microseconds"),
        (bad(0, [[1], [2, 3]]), "left: events are no arrays"),
        (bad(2, np.array([1001, 10**15])), "left t: goes on by 1e.09 s at event 1, more than"),
        (bad(2, np.array([10, 11])), "left t: goes back by 490 us at event 0"),
        (bad(3, np.array([2, 0])), "left polarity: must be bool, or 1 and 0 or -1"),
        (bad(3, np.array([True])), "left: x, y, t, polarity must have one length"),
        (GOOD[:3], "left: events must be a tuple of four arrays"),
    ],
)
def test_bad_events_are_refused_as_a_whole_and_the_odometry_goes_on(
    events: tuple, message: str
) -> None:
    live = LiveOdometry(room().rig, CONFIG)
    first = (np.array([1]), np.array([1]), np.array([500]), np.array([1]))
    live.push(first, first)
    with pytest.raises(InputError, match=message):
        live.push(events, GOOD)
    live.push(GOOD, GOOD)
    assert live.late == 0
    live.close()
    with pytest.raises(ValueError, match="closed"):
        live.push(GOOD, GOOD)


def test_hours_without_events_are_not_guessed_through_unless_they_are_announced() -> None:
    """Each quarter of a second of them would be a cluster; nobody waits for that."""
    live = LiveOdometry(room().rig, CONFIG)
    later = (*GOOD[:2], GOOD[2] + 10**13, GOOD[3])
    live.push(right=later)
    with pytest.raises(InputError, match=r"first events are 1e\+07 s apart, more than 600 s"):
        live.push(left=GOOD)
    live.push(left=later)
    live.interrupted()
    live.push(*2 * [(*GOOD[:2], GOOD[2] + 10**15, GOOD[3])])
    live.close()


def test_what_fails_in_the_second_thread_is_raised_by_the_next_call() -> None:
    def fail(step: Step) -> None:
        raise OSError("disk full")

    live = LiveOdometry(room().rig, CONFIG, observer=fail)
    sides = [raw(side.between(0.0, 0.1)) for side in (room().left, room().right)]
    with pytest.raises(OSError, match="disk full"):
        live.push(*sides)
        live.settle()
        live.push()
    with pytest.raises(OSError, match="disk full"):
        live.close()
    live.close()


def test_a_cluster_is_estimated_while_the_caller_goes_on_and_close_waits_for_it() -> None:
    goes_on, began, threads = Event(), Event(), []

    def wait_for_the_caller(step: Step) -> None:
        began.set()
        assert goes_on.wait(timeout=60)
        threads.append(get_ident())

    live = LiveOdometry(room().rig, CONFIG, observer=wait_for_the_caller)
    first, second = (report.stop for report in whole()[1][:2])  # the next is waited for
    sides = [side.between(0.0, (first + second) / 2) for side in (room().left, room().right)]
    returned = live.push(*map(raw, sides))
    assert began.wait(timeout=60) and returned == [] and threads == []
    goes_on.set()
    live.close()
    assert len(threads) == len(live.reports) > 0 and get_ident() not in threads


def test_watchers_are_called_when_all_is_ready_for_the_next_estimate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    live, calls = LiveOdometry(room().rig, CONFIG), []
    estimator = live.odometry.estimator
    prepare = estimator.prepare

    def note_and_prepare() -> None:
        calls.append("prepare")
        prepare()

    monkeypatch.setattr(estimator, "prepare", note_and_prepare)
    live.watch(lambda _: calls.append("watch"))
    live.observe(lambda _: calls.append("observe"))
    sides = [raw(side.between(0.0, 0.5)) for side in (room().left, room().right)]
    live.push(*sides)
    live.settle()
    estimated = [k for k, call in enumerate(calls) if call == "observe"]
    assert len(estimated) == len(live.reports) > 0
    assert all(calls[k : k + 3] == ["observe", "prepare", "watch"] for k in estimated)


def test_nothing_pushed_is_no_trajectory() -> None:
    with LiveOdometry(room().rig) as live:
        live.push()
    assert live.close() is None and live.latest() is None and live.start_ns is None
    with pytest.raises(InputError, match="no verdict: there was no cluster"):
        live.odometry.verdict()


def test_the_example_shows_the_pose_while_events_come(capsys: pytest.CaptureFixture[str]) -> None:
    names = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "live.py"))
    lines = capsys.readouterr().out.splitlines()
    assert all(" m, within " in line for line in lines)
    # Two clusters of 0.1 s may be reported by one push, and the first ones have no pose.
    t = np.array([float(line.partition(" s: ")[0]) for line in lines])
    first = next(report.stop for report in names["live"].reports if report.measurements)
    assert first < 0.35 and t[0] < first + 0.15 and t[-1] > 0.65
    assert (np.diff(t) >= 0).all() and np.diff(t).max() < 0.25


def test_arrays_that_are_pushed_and_estimates_that_are_returned_may_be_changed() -> None:
    """A driver fills the same buffers again, and a robot turns metres to millimetres in place."""
    kinds = np.uint16, np.uint16, np.int64, bool
    buffers = [[np.empty(len(room().left), kind) for kind in kinds] for _ in range(2)]
    live = LiveOdometry(room().rig, CONFIG)
    for start in np.arange(0.0, 0.6, 0.01):
        pair = []
        for side, arrays in zip((room().left, room().right), buffers, strict=True):
            columns = raw(side.between(start, start + 0.01))
            pair.append(tuple(array[: len(columns[2])] for array in arrays))  # type: ignore[arg-type]
            for array, column in zip(pair[-1], columns, strict=True):
                array[:] = column
        live.push(*pair)  # type: ignore[arg-type]
        if (now := live.latest()) is not None:
            now.twist[3:] *= 1000
            now.T_world_cam[:3, 3] *= 1000
    found = live.close()
    assert found is not None
    np.testing.assert_array_equal(found.T_world_cam, whole()[0].T_world_cam)


@pytest.mark.parametrize("patience", [-1.0, np.nan, 1e12])
def test_a_patience_that_is_no_time_is_refused(patience: float) -> None:
    with pytest.raises(InputError, match="patience"):
        LiveOdometry(room().rig, CONFIG, patience=patience)
