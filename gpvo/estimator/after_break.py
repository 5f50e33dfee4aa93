"""After a break: landmarks that were known before it tell where the camera is.

The states before the break stay in the window until then, so that all is solved together: given a
state within it, which is guessed, landmarks would be linearised far from the truth. New landmarks
may be tracked before known ones are found again; their measurements wait for these.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.estimator.dead_reckoning import ENOUGH, DeadReckoning
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.known_place import KnownPlace, PoseInWorld
from gpvo.estimator.lag_window import LagWindow
from gpvo.estimator.segments import SegmentKnots
from gpvo.estimator.state_times import SAME_TIME
from gpvo.mc_ransac.iterative import VelocityFit
from gpvo.tracking.measurements import Measurements
from gpvo.trajectory.states import States

Array = NDArray[np.float64]

PATIENCE = 0.3
"""Time for which known landmarks are waited for, seconds: the tracker finds them until then."""
FEW, MANY = 6, 10
"""Landmarks that agree on a pose, at least: to start the solver from, and to stay there."""


class AfterBreak:
    """Keeps the landmarks as they are known when their measurements cease."""

    def __init__(self, build: GraphBuilder, reckoning: DeadReckoning) -> None:
        self._build, self._reckoning = build, reckoning
        self._place: KnownPlace | None = None

    def keep(self, count: int, window: LagWindow, segments: SegmentKnots) -> None:
        """Keep what is known in a window if an update had too few measurements, `count`."""
        if count >= ENOUGH:
            self._place = None
        elif self._place is None:
            T = window.keys.T_world_cam[:1]
            covariance = window.first_covariance[:6, :6] + segments.pose_covariance(T)[0]
            last = window.keys.at(np.array([self._reckoning.measured_until]))
            landmarks = window.landmarks.points(window.numbered)
            self._place = KnownPlace(*landmarks, PoseInWorld(T[0], covariance), last)

    def leave_before(self, start: float, stop: float) -> float:
        """Time before which states leave, seconds, of a window from `start` to `stop`."""
        if self._place is None or not self._reckoning.holds(stop):
            return start
        return min(start, self._reckoning.measured_until)

    def awaits(self, stop: float, new: Measurements) -> bool:
        """Return whether new measurements until `stop`, seconds, wait for known landmarks."""
        start = _start_of(new)
        if self._place is None or not 0 <= stop - start <= PATIENCE:
            return False
        return self._reckoning.is_guessed(start) and self._place.known(new) < MANY

    def ends(self, new: Measurements, last: float, stop: float) -> Array:
        """Return the end of a cluster; before it that of a break, if new measurements end one.

        What is measured is no guess. The last state is at `last`, seconds.
        """
        start = _start_of(new)
        if len(new) < ENOUGH or not self._reckoning.is_guessed(start):
            return np.array([stop])
        self._reckoning.see(start)
        return np.array([start, stop] if start > last + SAME_TIME else [stop])

    def state(
        self, new: Measurements, guess: States, velocity: VelocityFit | None
    ) -> States | None:
        """Return the state (1,) that landmarks tell, from where the solver starts.

        It is at the first new measurement; `guess` is the last state. None if they do not tell, or
        the break was too long to be solved in one window.
        """
        start = _start_of(new)
        if not (self._reckoning.is_guessed(start) and self._reckoning.holds(start)):
            return None
        place = self.place(new, guess, velocity, FEW)
        if place is None:
            return None
        return States(np.array([start]), place.T_world_cam[None], _twist(guess, velocity)[None])

    def place(
        self, new: Measurements, guess: States, velocity: VelocityFit | None, least: int = MANY
    ) -> PoseInWorld | None:
        """Find the pose at the first new measurement; None if landmarks do not tell."""
        if self._place is None or len(new) < ENOUGH:
            return None
        noise, twist = self._build.noise, _twist(guess, velocity)
        return self._place.pose(self._build.camera, noise, new, twist, self._reckoning.speed, least)


def _start_of(new: Measurements) -> float:
    """Return the time of the first of new measurements, seconds; infinity if there are none."""
    return float(new.t.min(initial=np.inf))


def _twist(guess: States, velocity: VelocityFit | None) -> Array:
    """Return the twist (6,) that was measured, else the one that is guessed."""
    return guess.twist[-1] if velocity is None else velocity.velocity
