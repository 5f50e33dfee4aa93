"""Examples in public docstrings run, with what they speak of."""

from __future__ import annotations

import doctest
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, L, V, X

import factors
import gpvo
import gpvo.config
import gpvo.live
from factors import GaussianProcess, GyroFactor, InterpolatedFactor, StereoCamera, WnoaPriorFactor
from gpvo import FixedLagSmoother, LiveOdometry, Measurements, Odometry, open_recording
from gpvo.evaluation.report.run_time import CostMeter
from gpvo.recordings import Events

Names = dict[str, Any]


def examples(of: object) -> list[doctest.Example]:
    return doctest.DocTestParser().get_examples(of.__doc__ or "")


def graph_of_states() -> Names:
    states, qc = [(X(k), V(k), 0.1 * k) for k in range(4)], np.full(6, 0.01)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, j in pairwise(states):
        graph.add(WnoaPriorFactor(i, j, qc))
    for pose, velocity, _ in states:
        values.insert(pose, gtsam.Pose3())
        values.insert(velocity, np.zeros(6))
    loose = gtsam.noiseModel.Isotropic.Sigma(6, 0.1)
    graph.add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), loose))
    graph.add(gtsam.PriorFactorVector(V(0), np.zeros(6), loose))
    noise = gtsam.noiseModel.Isotropic.Sigma(3, 0.1)
    return {
        **{"states": states, "graph": graph, "values": values, "qc": qc, "noise": noise},
        **{"state_i": states[1], "state_j": states[2], "t": 0.123, "B": B},
        **{"position": np.zeros(3), "measured": np.zeros(3)},
    }


def seen_landmarks() -> Names:
    camera, count = StereoCamera(226.0, 226.0, 173.0, 130.0, 0.1), 20
    points = np.random.default_rng(0).uniform([-1, -1, 2], [1, 1, 4], (count, 3))
    number, t = np.arange(count), np.linspace(0.0, 0.19, count)
    stereo = camera.project(points)
    first = Measurements(number, np.zeros(count, int), t, stereo)
    second = Measurements(number, np.ones(count, int), t + 0.2, stereo)
    measurements = Measurements.concatenate([first, second])
    return {
        **graph_of_states(),
        **{"camera": camera, "measurements": measurements, "end_time": 0.4},
    }


def room_recording() -> Names:
    return {"recording": open_recording("room_data.hdf5", "camchain.yaml")}


def pushed_events() -> Names:
    recording = open_recording("room_data.hdf5", "camchain.yaml")
    parts = list(recording.event_batches(0.0, 0.3))
    sides = ([getattr(part, side) for part in parts] for side in ("left", "right"))
    left, right = (
        (each.x, each.y, np.rint(each.t * 1e6).astype(np.int64), each.polarity)
        for each in map(Events.concatenate, sides)
    )
    return {"rig": recording.rig, "left": left, "right": right}


SPOKEN_OF: dict[type, Callable[[], Names]] = {
    GaussianProcess: graph_of_states,
    InterpolatedFactor: graph_of_states,
    GyroFactor: graph_of_states,
    FixedLagSmoother: seen_landmarks,
    Odometry: room_recording,
    LiveOdometry: pushed_events,
    CostMeter: lambda: {},
}


@pytest.mark.parametrize("of", SPOKEN_OF, ids=lambda of: of.__name__)
def test_examples_of_a_docstring(of: type, room: Path) -> None:
    names = {**vars(gpvo), **vars(gpvo.config), **vars(factors), "gtsam": gtsam, "X": X, "L": L}
    names |= {"CostMeter": CostMeter} | SPOKEN_OF[of]()
    assert examples(of)
    for example in examples(of):
        exec(example.source, names)
    if smoother := names.get("smoother"):
        assert not smoother.diagnostics


def test_all_public_examples_are_run() -> None:
    packages = (gpvo, gpvo.live, factors)
    public = [getattr(package, name) for package in packages for name in package.__all__]
    shown = {each for each in public if isinstance(each, type) and examples(each)}
    assert shown <= set(SPOKEN_OF)
