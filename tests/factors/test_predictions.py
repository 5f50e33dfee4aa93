"""What a structureless factor says of measurements: residuals, and whether new ones fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import CAMERA
from gtsam.symbol_shorthand import L, V, X
from numpy.typing import NDArray
from windows import (
    NOISE,
    QC,
    Window,
    graph_of,
    keys,
    mean_and_covariance,
    moved_world,
    retracted,
)

from factors import (
    InterpolatedStereoFactor,
    LandmarkPrior,
    StructurelessStereoFactor,
    interpolate,
    marginalize,
)
from factors.lie import se3_exp, se3_inverse

Array = NDArray[np.float64]

SMOOTH = 0.01 * QC  # deviations between states are far below the noise
WINDOW = Window.simulated(4, 25, noise=1.0, qc=SMOOTH)
NEW = WINDOW.t >= WINDOW.t_states[-2]


@dataclass(frozen=True)
class Known:
    """A factor of all measurements but those of the last interval, solved."""

    factor: StructurelessStereoFactor
    values: gtsam.Values
    covariance: Array


def known(window: Window, qc: Any = SMOOTH) -> Known:
    old = window.t < window.t_states[-2]
    data = window.measured[old], window.t[old], window.landmark[old]
    prior = None if qc is not None else LandmarkPrior.none()  # for all states to be in the factor
    factor = StructurelessStereoFactor(*data, NOISE, window.states, CAMERA, qc, prior)
    graph, values = graph_of(window.chain(0, window.count - 1, SMOOTH), factor), window.truth
    for _ in range(3):
        step, covariance = mean_and_covariance(graph, values, keys(0, window.count))
        values = retracted(values, step, keys(0, window.count))
    return Known(factor, values, covariance)


def distances(window: Window, at: Known) -> Array:
    """(n,) of the measurements in the last interval."""
    new = window.t >= window.t_states[-2]
    data = window.measured[new], window.t[new], window.landmark[new]
    return at.factor.squared_distances(at.values, *data, at.covariance)


@pytest.mark.parametrize("qc", [None, QC])
def test_residuals_are_those_of_a_projection(qc: Any) -> None:
    """In the order in which the measurements were given."""
    order = np.random.default_rng(0).permutation(len(WINDOW.t))
    data = WINDOW.measured[order], WINDOW.t[order], WINDOW.landmark[order]
    factor = StructurelessStereoFactor(*data, NOISE, WINDOW.states, CAMERA, qc)
    values = retracted(WINDOW.truth, 1e-3 * np.arange(48), keys(0, 4))
    number, points = factor.landmarks(values)
    seen_from = (
        se3_inverse(poses(values, data[1]))
        @ np.column_stack([points[np.searchsorted(number, data[2])], np.ones(len(order))])[
            :, :, None
        ]
    )
    expected = CAMERA.project(seen_from[:, :3, 0]) - data[0]
    np.testing.assert_allclose(factor.residuals(values), expected, rtol=0, atol=1e-8)


def poses(values: gtsam.Values, t: Array) -> Array:
    """(n, 4, 4) interpolated between the four states."""
    T = np.array([values.atPose3(key).matrix() for key in keys(0, 4)[::2]])
    v = np.array([values.atVector(key) for key in keys(0, 4)[1::2]])
    i, stamps = np.searchsorted(WINDOW.t_states, t, side="right") - 1, WINDOW.t_states
    return interpolate(T[i], v[i], T[i + 1], v[i + 1], stamps[i], stamps[i + 1], t).pose


@pytest.mark.parametrize("qc", [None, QC])
def test_half_the_squared_residuals_are_the_cost(qc: Any) -> None:
    """Without Q_c; with it, states at the measurements' own times make it smaller."""
    factor = WINDOW.factor(0, qc)
    whitened = factor.residuals(WINDOW.truth) / NOISE.sigmas()
    cost = 0.5 * np.sum(whitened**2)
    if qc is None:
        np.testing.assert_allclose(factor.error(WINDOW.truth), cost, rtol=1e-9)
    else:
        assert 0 < factor.error(WINDOW.truth) < cost


def test_distances_are_chi_squared_on_simulated_data() -> None:
    """Of three degrees of freedom: the mean is three, and 99 of 100 are below 11.34."""
    windows = [Window.simulated(4, 25, noise=1.0, qc=SMOOTH, seed=seed) for seed in range(12)]
    found = np.concatenate([distances(window, known(window)) for window in windows])
    found = found[np.isfinite(found)]
    assert len(found) > 300
    assert 2.7 < found.mean() < 3.3
    assert 0.97 < np.mean(found < 11.34) <= 1


def test_distances_are_those_of_the_literal_prediction() -> None:
    """By the joint covariance of states and landmarks in a graph with both."""
    at = known(WINDOW, None)
    number, points = at.factor.landmarks(at.values)
    values, graph = gtsam.Values(at.values), graph_of(WINDOW.chain(0, 3, SMOOTH))
    for n, point in zip(number.tolist(), points, strict=True):
        values.insert(L(n), point)
    for row in np.flatnonzero(~NEW).tolist():
        graph.push_back(measurement(row))
    every = [*keys(0, 4), *(L(n) for n in number.tolist())]
    covariance = mean_and_covariance(graph, values, every)[1]
    covariance_of_states = covariance[:48, :48]
    new = WINDOW.measured[NEW], WINDOW.t[NEW], WINDOW.landmark[NEW]
    found = at.factor.squared_distances(at.values, *new, covariance_of_states)
    start = dict(zip(every, np.cumsum([0] + [6] * 8 + [3] * len(number)).tolist(), strict=False))
    for row, distance in zip(np.flatnonzero(NEW).tolist(), found.tolist(), strict=True):
        if WINDOW.landmark[row] not in number:
            assert np.isnan(distance)
            continue
        factor = measurement(row)
        own = tuple(factor.keys())
        A, minus_e = factor.linearize(values).jacobian()
        columns = np.concatenate(
            [start[key] + np.arange(3 if key in own[4:] else 6) for key in own]
        )
        spread = A @ covariance[np.ix_(columns, columns)] @ A.T + np.eye(3)
        expected = minus_e @ np.linalg.solve(spread, minus_e)
        np.testing.assert_allclose(distance, expected, rtol=1e-6)


def measurement(row: int) -> InterpolatedStereoFactor:
    """With the landmark as a point."""
    t = float(WINDOW.t[row])
    k, n = int(np.searchsorted(WINDOW.t_states, t, side="right")) - 1, int(WINDOW.landmark[row])
    interval = *WINDOW.t_states[k : k + 2].tolist(), t
    return InterpolatedStereoFactor(
        WINDOW.measured[row], NOISE, X(k), V(k), X(k + 1), V(k + 1), L(n), CAMERA, *interval
    )


def test_a_landmark_that_is_not_known_has_no_distance() -> None:
    at, new = known(WINDOW), np.array([200.0, 130.0, 8.0])
    t = np.full(3, WINDOW.t_states[-1])
    numbers = [-5, int(WINDOW.landmark[~NEW][0]), 10**12]
    found = at.factor.squared_distances(at.values, [new] * 3, t, numbers, at.covariance)
    np.testing.assert_array_equal(np.isnan(found), [True, False, True])
    only = at.factor.squared_distances(at.values, [new], t[:1], -5, at.covariance)
    np.testing.assert_array_equal(only, [np.nan])


def test_a_prior_knows_landmarks_too() -> None:
    """After their measurements have left: as far away as before."""
    at = known(WINDOW)
    later = np.unique(WINDOW.landmark)
    left = marginalize(at.factor, at.values, 2, WINDOW.chain(0, 2, SMOOTH), later, shared=1000)
    none = np.empty((0, 3)), [], np.empty(0, int)
    alone = StructurelessStereoFactor(*none, NOISE, WINDOW.states[2:], CAMERA, SMOOTH, left.prior)
    new = WINDOW.measured[NEW], WINDOW.t[NEW], WINDOW.landmark[NEW]
    expected = at.factor.squared_distances(at.values, *new, at.covariance)
    found = alone.squared_distances(at.values, *new, at.covariance[24:, 24:])
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_the_world_frame_does_not_matter() -> None:
    S, at = se3_exp(np.array([0.5, -1.0, 0.7, 2.0, -3.0, 1.0])), known(WINDOW)
    far = Known(at.factor, moved_world(at.values, S), at.covariance)
    expected = distances(WINDOW, at), at.factor.residuals(at.values)
    found = distances(WINDOW, far), at.factor.residuals(far.values)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-5)
    np.testing.assert_allclose(found[1], expected[1], rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("measured", {"measured": [[1.0, 2.0, -1.0]]}),
        ("times", {"times": [0.1, 0.2]}),
        ("times", {"times": [99.0]}),
        ("landmarks", {"landmarks": [0.5]}),
    ],
)
def test_the_wrong_argument_is_named(name: str, change: dict[str, Any]) -> None:
    at = known(WINDOW)
    n = int(WINDOW.landmark[~NEW][0])
    good = {"measured": [[200.0, 130.0, 8.0]], "times": [0.1], "landmarks": [n]}
    with pytest.raises(ValueError, match=name):
        at.factor.squared_distances(at.values, **{**good, **change}, covariance=at.covariance)
