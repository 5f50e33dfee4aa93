"""The odometry of a running camera: events are pushed as they come, the pose is there at once."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from threading import Lock
from typing import Any

from gpvo.cluster_report import ClusterReport
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.live.pairing import StereoPairing
from gpvo.live.raw_events import NO_EVENTS, RawEvents
from gpvo.observer import Observer, Step, no_observer, observers
from gpvo.odometry import Odometry
from gpvo.recordings import StereoEvents, StereoRig
from gpvo.recordings.streams import EventBlock
from gpvo.trajectory import MotionEstimate, Trajectory

LONGEST = 1e6
"""Seconds: no camera is late by more."""


class LiveOdometry:
    """Estimates the motion of a stereo event camera while its events come.

    >>> live = LiveOdometry(rig)
    >>> live.push(left, right)  # each (x, y, t, polarity), t in microseconds
    >>> live.latest().T_world_cam
    >>> trajectory = live.close()

    The same events give the same states, bit for bit, as `Odometry.run`, however they are cut into
    pushes. `push` tracks the clusters that the events complete, in the thread that calls it; each
    is estimated in a second thread while the caller goes on. What fails there is raised by the next
    call. `latest` and `trajectory` may be called from any thread.

    Parameters
    ----------
    rig
        The calibrated stereo rig.
    configuration
        By default `Configuration()`.
    observer
        Called with a `Step` after each cluster, in the second thread.
    patience
        Event time after which a camera that is behind the other is not waited for, seconds. Events
        that come later still are left out, and counted in `late`. inf waits for ever.
    stage
        Entered around every stage with the stage's name, to time it.
    right_offset
        Seconds by which the right camera's stamps are late, to the nanosecond; its events are taken
        earlier by that, as `gpvo run --right-offset` does.

    Attributes
    ----------
    reports
        What became of each cluster so far.

    Raises
    ------
    InputError
        If the offset or the patience is not a time, or too long, or the rig or the configuration is
        something else, such as a path.
    """

    def __init__(
        self,
        rig: StereoRig,
        configuration: Configuration | None = None,
        observer: Observer = no_observer,
        patience: float = 0.5,
        stage: Callable[[str], AbstractContextManager[Any]] = nullcontext,
        right_offset: float = 0.0,
    ) -> None:
        if not abs(right_offset) <= LONGEST:
            raise InputError(
                f"right_offset: {right_offset} must be a number of seconds, at most {LONGEST:g}"
            )
        if not 0 <= patience <= LONGEST:
            raise InputError(f"patience: {patience} must be seconds from 0 to {LONGEST:g}")
        self.right_offset = right_offset
        self._latest: MotionEstimate | None = None
        self._lock = Lock()
        self._closed = False
        self._observers, self._watchers = [self._keep, observer], list[Observer]()
        self.odometry = Odometry(
            rig,
            configuration,
            stage,
            observer=lambda step: observers(*self._observers)(step),
            watcher=lambda step: observers(*self._watchers)(step),
        )
        self.reports = self.odometry.reports
        self._pairing = StereoPairing(rig, patience, right_offset, self.odometry.is_due)

    @property
    def start_ns(self) -> int | None:
        """Absolute stamp of t = 0, the first event of either camera, nanoseconds; None before."""
        return self._pairing.start_ns

    @property
    def late(self) -> int:
        """Number of events that came after their time had been given up."""
        return self._pairing.late

    def push(
        self, left: RawEvents = NO_EVENTS, right: RawEvents = NO_EVENTS
    ) -> list[ClusterReport]:
        """Take the next events of each camera, any number.

        Returns the reports of the clusters that were estimated since the call before.

        Raises
        ------
        InputError
            If the events are not four arrays of whole numbers and one length, lie outside the
            sensor, go back in time, or go on by more than 600 s at once without a call of
            `interrupted` before. None of them is used then, and the odometry goes on.
        ValueError
            After `close`.
        """
        with self._lock:
            self._check_open()
            return self._estimate(self._pairing.push(*self._pairing.checked(left, right)))

    def push_checked(self, left: EventBlock, right: EventBlock) -> list[ClusterReport]:
        """Take the next events of each camera, which are on the sensor and in order of time.

        The arrays become the odometry's: they must not be changed any more.

        Returns the reports of the clusters that were estimated since the call before.

        Raises
        ------
        ValueError
            After `close`.
        """
        with self._lock:
            self._check_open()
            return self._estimate(self._pairing.push(left, right))

    def interrupted(self, on_purpose: bool = False) -> list[ClusterReport]:
        """Say that data is missing between the events so far and the next ones.

        What waits is estimated. The time until the next events is taken for a fault of the cameras
        unless events were left out `on_purpose`.
        """
        with self._lock:
            self._check_open()
            reports = self._estimate(self._pairing.end())
            if on_purpose:
                self.odometry.skip()
            return reports

    def settle(self) -> None:
        """Wait until all clusters that were pushed are estimated."""
        with self._lock:
            self.odometry.settle()

    def observe(self, observer: Observer) -> None:
        """Call one more observer after each cluster from now on."""
        self._observers.append(observer)

    def watch(self, watcher: Observer) -> None:
        """Call one that takes its time, when all is ready for the next estimate, from now on."""
        self._watchers.append(watcher)

    def latest(self, t: float | None = None) -> MotionEstimate | None:
        """Return the estimate at the newest state, or extrapolated to t, in constant time.

        It is None before the first measurement.

        Raises
        ------
        ValueError
            If t, seconds since `start_ns`, is before the newest state, or not finite.
        """
        latest = self._latest
        return latest if latest is None or t is None else latest.at(t)

    def trajectory(self) -> Trajectory | None:
        """Return the trajectory so far; None before the first measurement."""
        with self._lock:
            self.odometry.settle()
            return self.odometry.trajectory(self.start_ns or 0)

    def close(self) -> Trajectory | None:
        """Estimate what waits; return the whole trajectory, None if nothing was measured."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._estimate(self._pairing.end())
                list(self.odometry.end())
        return self.trajectory()

    def __enter__(self) -> LiveOdometry:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _check_open(self) -> None:
        if self._closed:
            raise ValueError("the live odometry is closed")

    def _estimate(self, batch: StereoEvents | None) -> list[ClusterReport]:
        return list(self.odometry.estimated() if batch is None else self.odometry.push(batch))

    def _keep(self, step: Step) -> None:
        self._latest = step.estimator.latest()
