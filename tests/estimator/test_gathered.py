"""Measurements of short clusters reach the estimator once each, in order, not too often."""

from __future__ import annotations

from threading import Thread
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_info

from gpvo.config.stages import EstimatorConfig
from gpvo.estimator import (
    Estimator,
    FixedLagSmoother,
    GatheredMeasurements,
    one_blas_thread,
)
from gpvo.odometry import Odometry
from gpvo.simulation import SimulationConfig, simulate
from gpvo.tracking.measurements import Measurements

SIMULATED = SimulationConfig(duration=0.6, resolution=(160, 120), focal_length=110.0)


def measured(landmarks: list[int], t: float) -> Measurements:
    count = len(landmarks)
    return Measurements(
        np.array(landmarks, np.int64),
        np.zeros(count, np.int64),
        np.full(count, t),
        np.ones((count, 3)),
    )


@given(
    st.lists(st.floats(0.005, 0.1), min_size=1, max_size=20),
    st.sampled_from([0.0, 0.02, 0.04, 0.2]),
)
@settings(deadline=None, max_examples=60)
def test_every_measurement_is_passed_on_once_and_updates_are_an_interval_apart(
    durations: list[float], interval: float
) -> None:
    calls: list[tuple[float, list[int]]] = []
    estimator = SimpleNamespace(
        update=lambda stop, added, velocity: calls.append((stop, added.landmark.tolist()))
    )
    config = EstimatorConfig(interval=interval, start_landmarks=0)
    gathered = GatheredMeasurements(cast(Estimator, estimator), config)
    stops = np.cumsum(durations).tolist()
    for number, stop in enumerate(stops):
        gathered.add(stop, measured([2 * number, 2 * number + 1], stop - 0.001), None)
    regular = len(calls)
    gathered.end()
    gathered.end()
    assert [one for _, landmarks in calls for one in landmarks] == list(range(2 * len(stops)))
    assert calls[0][0] == stops[0] and calls[-1][0] == stops[-1]
    assert len(calls) <= regular + 1
    assert (np.diff([stop for stop, _ in calls[:regular]]) >= interval).all()
    if interval == 0:
        assert regular == len(stops)


def threads() -> set[int]:
    return {
        library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"
    }


def test_one_blas_thread_holds_until_the_last_of_all_threads_leaves() -> None:
    before = threads()
    with one_blas_thread():
        other = Thread(target=enter_and_leave)
        other.start()
        other.join()
        assert threads() == {1}
    assert threads() == before


def enter_and_leave() -> None:
    with one_blas_thread():
        pass


def test_every_update_of_a_run_has_one_blas_thread() -> None:
    """Whatever thread it is in: with several, its last bits would depend on the moment."""
    seen: list[set[int]] = []

    class Watched(FixedLagSmoother):
        def update(self, *given: Any) -> None:
            seen.append(threads())
            super().update(*given)

    recording = simulate(SIMULATED)
    camera = Odometry(recording.rig).camera
    Odometry(recording.rig, estimator=Watched(camera)).run(recording)
    assert len(seen) > 5 and all(each == {1} for each in seen)
