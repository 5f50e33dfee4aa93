"""States leave a window, and nothing that was known of the others and of landmarks is lost."""

from __future__ import annotations

import dataclasses
from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import CAMERA
from gtsam.symbol_shorthand import L, X
from numpy.typing import NDArray
from windows import (
    NOISE,
    QC,
    Window,
    chain,
    graph_of,
    in_sigmas,
    keys,
    mean_and_covariance,
    moved_points,
    moved_world,
    of_correlations,
    retracted,
)

from factors import LandmarkPrior, Marginal, StructurelessStereoFactor, marginalize
from factors.lie import se3_exp, se3_inverse
from factors.structureless import marginalization
from factors.structureless.joint_system import Eliminated
from factors.structureless.marginalization import _Known

Array = NDArray[np.float64]

WINDOW = Window.simulated(count=5, landmarks=14, seen=6)
ALL = 10_000  # more variables than any prior here has
PROCESS = pytest.mark.parametrize("qc", [None, QC], ids=["interpolated", "own states"])


def information_of_the_prior(prior: LandmarkPrior, state: bool = True) -> Array:
    """JᵀJ of the landmarks' coordinates, the state and the shared variables, in this order."""
    count, d = len(prior), prior.shared
    J = np.zeros((3 * count + d, 3 * count + 12 + d))
    for k in range(count):
        rows = slice(3 * k, 3 * k + 3)
        J[rows, rows] = prior.root[k]
        J[rows, 3 * count : -d or None] = prior.by_state[k]
        J[rows, 3 * count + 12 :] = prior.by_shared[k]
    J[3 * count :, 3 * count + 12 :] = np.eye(d)
    return J.T @ J


def given_state(prior: LandmarkPrior) -> Array:
    """(3 P, 3 P) covariance of the landmarks' coordinates, given the state."""
    R = np.linalg.inv(prior.root)
    gain = (R @ prior.by_shared).reshape(3 * len(prior), -1)
    spread = gain @ gain.T
    for k in range(len(prior)):
        rows = slice(3 * k, 3 * k + 3)
        spread[rows, rows] += R[k] @ R[k].T
    return spread


def marginal(
    window: Window,
    values: gtsam.Values,
    qc: Any,
    count: int,
    tolerance: float = 1e-14,
    **options: Any,
) -> Marginal:
    """The first `count` states leave."""
    factor = window.factor(0, qc, None if qc is not None else LandmarkPrior.none(), tolerance)
    others = window.chain(0, count, QC)
    options = {"shared": ALL, **options}
    return marginalize(factor, values, count, others, window.later(count), **options)


@PROCESS
@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_states_that_stay_are_where_they_were_and_as_certain(qc: Any, count: int) -> None:
    values, all_keys = WINDOW.truth, keys(0, WINDOW.count)
    motion = WINDOW.chain(0, WINDOW.count - 1)
    whole = mean_and_covariance(graph_of(motion, WINDOW.factor(0, qc)), values, all_keys)
    left = marginal(WINDOW, values, qc, count)
    following = WINDOW.factor(count, qc, left.prior)
    found = mean_and_covariance(graph_of(motion, left.factor, following), values, all_keys)
    without = graph_of(motion, left.factor, WINDOW.factor(count, qc))
    forgotten = mean_and_covariance(without, values, all_keys)[1]
    stay = slice(12 * count, None)
    assert of_correlations(forgotten[stay, stay], whole[1][stay, stay]) > 0.05  # landmarks matter
    assert in_sigmas(found[0][stay], whole[0][stay], whole[1][stay, stay]) < 1e-9
    assert of_correlations(found[1][stay, stay], whole[1][stay, stay]) < 1e-9


@PROCESS
def test_noise_moves_the_states_that_stay_as_in_the_whole_window(qc: Any) -> None:
    """Where the values are the optimum, both are linearised there."""
    window = Window.simulated(count=4, landmarks=12, noise=0.2, qc=QC, seed=3)
    all_keys, motion = keys(0, 4), window.chain(0, 3)
    tolerance = 1e-6
    graph, values = graph_of(motion, window.factor(0, qc, None, tolerance)), window.truth
    for _ in range(4):
        values = retracted(values, mean_and_covariance(graph, values, all_keys)[0], all_keys)
    whole = mean_and_covariance(graph, values, all_keys)
    left = marginal(window, values, qc, 2, tolerance)
    following = window.factor(2, qc, left.prior, tolerance)
    found = mean_and_covariance(graph_of(motion, left.factor, following), values, all_keys)
    stay = slice(24, None)
    assert in_sigmas(found[0][stay], whole[0][stay], whole[1][stay, stay]) < 0.005
    assert of_correlations(found[1][stay, stay], whole[1][stay, stay]) < 0.005


@PROCESS
def test_twice_in_a_row(qc: Any) -> None:
    """What the first marginalisation left of states and landmarks is marginalised again."""
    values, all_keys = WINDOW.truth, keys(0, WINDOW.count)
    motion = WINDOW.chain(0, WINDOW.count - 1)
    whole = mean_and_covariance(graph_of(motion, WINDOW.factor(0, qc)), values, all_keys)
    first = marginal(WINDOW, values, qc, 1)
    between = WINDOW.factor(1, qc, first.prior)
    others = held(WINDOW, first, values)
    second = marginalize(between, values, 2, others, WINDOW.later(3), shared=ALL)
    following = WINDOW.factor(3, qc, second.prior)
    graph = graph_of(motion, first.factor, second.factor, following)
    found = mean_and_covariance(graph, values, all_keys)
    stay = slice(36, None)
    assert in_sigmas(found[0][stay], whole[0][stay], whole[1][stay, stay]) < 1e-9
    assert of_correlations(found[1][stay, stay], whole[1][stay, stay]) < 1e-9


@PROCESS
def test_landmarks_that_are_away_for_a_while_hold_the_states_when_they_come_back(qc: Any) -> None:
    """They are in no measurement of a window that is marginalised meanwhile."""
    window = Window.simulated(count=5, landmarks=40, seen=6)
    t, t_1, t_3 = window.t, window.t_states[1], window.t_states[3]
    away = np.intersect1d(window.landmark[t < t_1], window.later(3))
    assert len(away) >= 3
    window = window.only(~np.isin(window.landmark, away) | (t < t_1) | (t >= t_3))
    values, all_keys, motion = window.truth, keys(0, 5), window.chain(0, 4)
    whole = mean_and_covariance(graph_of(motion, window.factor(0, qc)), values, all_keys)
    early, every = window.only(window.t < t_3), np.unique(window.landmark)
    none = None if qc is not None else LandmarkPrior.none()
    first = marginalize(early.factor(0, qc, none), values, 1, early.chain(0, 1), every, shared=ALL)
    between, others = early.factor(1, qc, first.prior), held(window, first, values)
    assert np.isin(away, between.landmark_numbers).all()
    second = marginalize(between, values, 2, others, every, shared=ALL)
    following = window.factor(3, qc, second.prior)
    forgotten = window.factor(3, qc, second.prior.only(~np.isin(second.prior.number, away)))
    stay, found = slice(36, None), {}
    for last in (following, forgotten):
        graph = graph_of(motion, first.factor, second.factor, last)
        found[last] = mean_and_covariance(graph, values, all_keys)[1][stay, stay]
    assert of_correlations(found[following], whole[1][stay, stay]) < 1e-9
    assert of_correlations(found[forgotten], whole[1][stay, stay]) > 0.01


def held(window: Window, first: Marginal, values: gtsam.Values) -> gtsam.NonlinearFactorGraph:
    """What the first state, which left, tells of the second, and the motion up to the fourth."""
    before = graph_of(window.chain(0, 1), first.factor)
    information = before.linearize(values).eliminatePartialMultifrontal(
        ordering(keys(0, 1)), gtsam.EliminateQR
    )[1]
    parts = (gtsam.LinearContainerFactor(part, values) for part in factors_of(information))
    return graph_of(graph_of(*parts), window.chain(1, 3))


def ordering(of: list[int]) -> gtsam.Ordering:
    result = gtsam.Ordering()
    for key in of:
        result.push_back(key)
    return result


def factors_of(graph: gtsam.GaussianFactorGraph) -> list[Any]:
    return [graph.at(n) for n in range(graph.size())]


@PROCESS
def test_a_prior_by_itself_tells_nothing_of_the_states(qc: Any) -> None:
    values = WINDOW.truth
    prior = marginal(WINDOW, values, qc, 2).prior
    none = np.empty((0, 3)), [], np.empty(0, int)
    states = WINDOW.states[2:]
    factor = StructurelessStereoFactor(*none, NOISE, states, CAMERA, qc, prior)
    A, b = factor.linearize(values).jacobian()
    scale = np.sqrt(np.einsum("prc,prc->c", prior.by_state, prior.by_state)).max()
    assert np.abs(A).max() < 1e-5 * scale
    assert np.abs(b).max() < 1e-9


@PROCESS
def test_the_world_frame_does_not_matter(qc: Any) -> None:
    """Neither to what is marginalised nor to what is done with it."""
    values, S = WINDOW.truth, se3_exp(np.array([0.5, -1.0, 0.7, 2.0, -3.0, 1.0]))
    here = marginal(WINDOW, values, qc, 2)
    factor = WINDOW.factor(0, qc, None if qc is not None else LandmarkPrior.none())
    others = chain(WINDOW.t_states, 0, 2, moved_world(values, S))
    there = marginalize(factor, moved_world(values, S), 2, others, WINDOW.later(2), shared=ALL)
    np.testing.assert_allclose(there.prior.seen, here.prior.seen, atol=1e-9)
    expected = given_state(here.prior)
    assert of_correlations(given_state(there.prior), expected) < 1e-9
    step = np.random.default_rng(0).normal(size=6 * len(keys(0, 5))) * 1e-3
    near = retracted(values, step, keys(0, 5))
    far = moved_world(near, S)
    assert of_error(there.factor, far) == pytest.approx(of_error(here.factor, near), rel=1e-6)
    following = WINDOW.factor(2, qc, here.prior), WINDOW.factor(2, qc, there.prior)
    moved = dataclasses.replace(here.prior, T_world_cam=S @ here.prior.T_world_cam)
    same = WINDOW.factor(2, qc, moved)
    (A, b), (A_far, b_far) = (
        each.linearize(at).jacobian() for each, at in ((following[0], near), (same, far))
    )
    np.testing.assert_allclose(A_far.T @ A_far, A.T @ A, atol=1e-6 * np.abs(A.T @ A).max())
    np.testing.assert_allclose(A_far.T @ b_far, A.T @ b, atol=1e-6 * np.abs(A.T @ b).max())
    for each in (following[1], same):
        assert of_error(each, far) == pytest.approx(of_error(following[0], near), rel=1e-4)


def of_error(factor: gtsam.NonlinearFactor, values: gtsam.Values) -> float:
    return float(factor.error(values))


def test_few_shared_variables_stand_for_all() -> None:
    """Of many landmarks: the errors that they share come from few states."""
    window = Window.simulated(count=4, landmarks=60, seed=1)
    values, motion = window.truth, window.chain(0, 3)
    qc, stay, tolerance = QC, slice(24, None), 1e-4
    found = {}
    for shared in (0, 24, ALL):
        left = marginal(window, values, qc, 2, tolerance, shared=shared)
        assert left.prior.shared <= shared
        following = window.factor(2, qc, left.prior, tolerance)
        graph = graph_of(motion, left.factor, following)
        found[shared] = mean_and_covariance(graph, values, keys(0, 4))[1][stay, stay]
    assert of_correlations(found[24], found[ALL]) < 0.05
    assert of_correlations(found[24], found[ALL]) < 0.5 * of_correlations(found[0], found[ALL])


def test_fewer_shared_variables_leave_each_landmark_as_certain() -> None:
    """What the others add goes to the landmark's own noise: only correlations are lost."""
    values = WINDOW.truth
    few, many = (marginal(WINDOW, values, QC, 2, shared=n).prior for n in (6, ALL))
    assert few.shared == 6
    for k in range(len(many)):
        own = slice(3 * k, 3 * k + 3)
        expected = given_state(many)[own, own]
        assert of_correlations(given_state(few)[own, own], expected) < 1e-6


def test_drift_makes_landmarks_less_certain() -> None:
    values = WINDOW.truth
    still, drifted, farther = (
        marginal(WINDOW, values, QC, 2, drift=(d, d, 2 * d)).prior for d in (0, 0.3, 0.6)
    )
    for sharper, wider in ((still, drifted), (drifted, farther)):
        np.testing.assert_array_equal(wider.seen, sharper.seen)
        less = information_of_the_prior(sharper) - information_of_the_prior(wider)
        scale = np.sqrt(np.diag(information_of_the_prior(sharper)))
        assert np.linalg.eigvalsh(less / np.outer(scale, scale))[0] > -1e-10
    # Of each landmark by itself it is the variance of the tracks that is added, given the state.
    pixels = np.array([0.3, 0.3, 0.6]) / [CAMERA.fx, CAMERA.fy, CAMERA.fx * CAMERA.baseline]
    added = given_state(drifted) - given_state(still)
    expected = np.diag(np.tile(pixels**2, len(still)))
    np.testing.assert_allclose(added, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_each_landmark_may_drift_by_itself() -> None:
    values, numbers = WINDOW.truth, WINDOW.factor(0, QC).landmark_numbers
    one = np.where((numbers == numbers[0])[:, None], [0.3, 0.3, 0.6], 0.0)
    still, all_alike, alone = (
        marginal(WINDOW, values, QC, 2, drift=d).prior for d in ((0, 0, 0), (0.3, 0.3, 0.6), one)
    )
    first = still.number == numbers[0]
    assert first.any() and not first.all()
    np.testing.assert_array_equal(alone.root[first], all_alike.root[first])
    np.testing.assert_array_equal(alone.root[~first], still.root[~first])


def test_landmarks_behind_the_camera_are_known_in_another_view() -> None:
    """The camera turns by more than a right angle on its way to the state that stays."""
    values = gtsam.Values(WINDOW.truth)
    turned = gtsam.Pose3(gtsam.Rot3.Ry(2.0), np.zeros(3))
    values.update(X(2), values.atPose3(X(2)).compose(turned))
    for count, behind in ((1, False), (2, True)):
        factor, others = WINDOW.factor(0, QC), WINDOW.chain(0, count)
        prior = marginalize(factor, values, count, others, WINDOW.landmark).prior
        T = se3_inverse(prior.views(values.atPose3(X(count)).matrix()))
        points = dict(zip(*factor.landmarks(values), strict=True))
        local = moved_points(T, np.array([points[number] for number in prior.number]))
        assert (local[:, 2] > 0.5 * np.linalg.norm(local, axis=1)).all()
        expected = np.column_stack([local[:, :2], np.ones(len(local))]) / local[:, 2:]
        np.testing.assert_allclose(prior.seen, expected, atol=1e-6)
        found = prior.points(values.atPose3(X(count)).matrix())
        np.testing.assert_allclose(found, [points[number] for number in prior.number], atol=1e-5)
        assert (prior.R_cam_view != np.eye(3)).any() == behind


@PROCESS
def test_the_views_do_not_matter(qc: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the states that stay, whose information the prior's landmarks share."""
    found = {}
    for turn in (0.0, 0.8):
        R = se3_exp([0.3 * turn, turn, 0.1 * turn, 0, 0, 0])[:3, :3]
        monkeypatch.setattr(marginalization, "VIEWS", np.tile(R, (6, 1, 1)))
        left = marginal(WINDOW, WINDOW.truth, qc, 2)
        motion, following = WINDOW.chain(0, WINDOW.count - 1), WINDOW.factor(2, qc, left.prior)
        graph, at = graph_of(motion, left.factor, following), WINDOW.truth
        found[turn] = mean_and_covariance(graph, at, keys(0, WINDOW.count))[1]
    assert of_correlations(found[0.8], found[0.0]) < 1e-9


def test_redundancy_counts_what_is_measured_here() -> None:
    left = marginal(WINDOW, WINDOW.truth, QC, 2)
    following = WINDOW.factor(2, QC, left.prior)
    later = WINDOW.landmark[WINDOW.t >= WINDOW.t_states[2]]
    assert following.redundancy == 3 * (len(later) - len(np.unique(later)))


def test_only_landmarks_that_are_kept_and_measured_are_in_the_prior() -> None:
    values, count = WINDOW.truth, 2
    left = marginal(WINDOW, values, QC, count)
    before = np.unique(WINDOW.landmark[WINDOW.t < WINDOW.t_states[count]])
    assert set(left.prior.number) <= set(before) & set(WINDOW.later(count))
    assert (np.diff(left.prior.number) > 0).all()
    factor, others = WINDOW.factor(0, QC), WINDOW.chain(0, count)
    nothing = marginalize(factor, values, count, others, np.empty(0, int))
    assert len(nothing.prior) == 0


def test_landmarks_that_are_lost_are_no_landmarks_of_the_states_either() -> None:
    """Without later measurements the factor of the states alone is the whole truth."""
    values, count = WINDOW.truth, 4
    early = WINDOW.t < WINDOW.t_states[count]
    assert early.all()  # nothing is measured after the last state
    motion = WINDOW.chain(0, count)
    whole = mean_and_covariance(graph_of(motion, WINDOW.factor(0, QC)), values, keys(0, 5))
    left = marginalize(WINDOW.factor(0, QC), values, count, motion, [], shared=ALL)
    found = mean_and_covariance(graph_of(motion, left.factor), values, keys(0, 5))
    assert in_sigmas(found[0], whole[0], whole[1]) < 1e-9
    assert of_correlations(found[1], whole[1]) < 1e-9


@pytest.mark.parametrize("count", [-1, 0, 5, 6])
def test_one_state_leaves_and_one_stays_at_least(count: int) -> None:
    factor, others = WINDOW.factor(0, QC), WINDOW.chain(0, 1)
    with pytest.raises(ValueError, match="count"):
        marginalize(factor, WINDOW.truth, count, others, [])


def test_states_that_nothing_holds_are_refused() -> None:
    """Neither a start nor a motion prior, and landmarks measured once."""
    states = WINDOW.states[:3]
    measured, times = WINDOW.measured[:2], WINDOW.t[:2]
    factor = StructurelessStereoFactor(measured, times, [0, 1], NOISE, states, CAMERA, QC)
    with pytest.raises(ValueError, match="not determined"):
        marginalize(factor, WINDOW.truth, 1, gtsam.NonlinearFactorGraph(), [0, 1])


@pytest.mark.parametrize("drift", [(0.1, 0.1), (0.1, np.nan, 0.1), 0.1, np.zeros((1, 3))])
def test_drift_is_of_three_coordinates(drift: Any) -> None:
    with pytest.raises(ValueError, match="drift"):
        marginal(WINDOW, WINDOW.truth, QC, 1, drift=drift)


def test_what_is_known_of_landmarks_that_have_moved() -> None:
    """It is as if they had drifted by as much before; those that have not are known as before."""
    d = np.array([0.3, 0.3, 0.6])
    still, drifted = (marginal(WINDOW, WINDOW.truth, QC, 2, drift=x).prior for x in (0.0 * d, d))
    some = np.arange(len(still)) % 2 == 0
    moved = still.moved(np.where(some[:, None], d, 0.0), CAMERA)
    np.testing.assert_array_equal(moved.root[~some], still.root[~some])
    np.testing.assert_array_equal(moved.rows[~some], still.rows[~some])
    whole = still.moved(d, CAMERA)
    expected = given_state(drifted)
    np.testing.assert_allclose(given_state(whole), expected, atol=1e-6 * np.abs(expected).max())
    means = [np.linalg.solve(prior.root, prior.rows) for prior in (whole, still)]
    np.testing.assert_allclose(*means, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("shift", [L(0), 2**63 - 1 - int(WINDOW.landmark.max())])
def test_identities_may_be_as_large_as_keys(shift: int) -> None:
    """No number is rounded, and none is kept for a purpose of its own."""
    large = dataclasses.replace(WINDOW, landmark=WINDOW.landmark + shift)
    small, found = (marginal(window, WINDOW.truth, QC, 2) for window in (WINDOW, large))
    np.testing.assert_array_equal(found.prior.number, small.prior.number + shift)
    following = [w.factor(2, QC, m.prior) for w, m in ((WINDOW, small), (large, found))]
    assert following[0].error(WINDOW.truth) == following[1].error(WINDOW.truth)
    assert following[0].redundancy == following[1].redundancy


def test_landmarks_that_a_far_step_takes_behind_their_view_are_forgotten() -> None:
    """One of them had made the whole prior infinite."""
    eye = np.tile(np.eye(4), (3, 1, 1))
    coordinates = np.array([[0.1, 0.2, 0.5], [0.1, 0.2, -0.01], [0.1, 0.2, 0.5]])
    rows = Eliminated(np.arange(1), np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 3, 1)), np.ones(3))
    rows.known[2] = 0.0
    known = _Known(np.arange(3), eye, coordinates, np.zeros((3, 3)), rows)
    np.testing.assert_array_equal(known.is_known, [True, False, False])
    np.testing.assert_array_equal(known.only(known.is_known).number, [0])
