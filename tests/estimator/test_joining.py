"""Pieces of a trajectory meet without a jump, and move no more than the process says."""

from __future__ import annotations

import tracemalloc
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from factors.lie import se3_exp, se3_inverse, se3_log
from gpvo.estimator.final_states import (
    FinalStates,
    correct_final_states,
    led_to,
    share_correction,
)
from gpvo.trajectory import States


def ends(rng: np.random.Generator, duration: float, size: float) -> States:
    T = se3_exp(rng.normal(size=(2, 6)) * size)
    return States(np.array([0.0, duration]), T, rng.normal(size=(2, 6)))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 999), st.floats(1e-3, 1.0), st.floats(0, 0.5))
def test_an_interpolated_piece_is_interpolated_to_its_new_end(
    seed: int, duration: float, size: float
) -> None:
    rng = np.random.default_rng(seed)
    before, after = ends(rng, duration, size), ends(rng, duration, size)
    t = np.sort(np.append(rng.uniform(0, duration, 5), before.t))
    moved = correct_final_states(before.at(t), after[1:])
    expected = States.concatenate([before[:1], after[1:]]).at(t)
    np.testing.assert_allclose(moved.T_world_cam, expected.T_world_cam, atol=1e-12)
    np.testing.assert_allclose(moved.twist, expected.twist, atol=1e-9 / duration)


def test_a_piece_whose_end_stays_stays() -> None:
    rng = np.random.default_rng(0)
    piece = States(np.arange(4.0), se3_exp(rng.normal(size=(4, 6))), rng.normal(size=(4, 6)))
    moved = correct_final_states(piece, piece[-1:])
    np.testing.assert_allclose(moved.T_world_cam, piece.T_world_cam, atol=1e-12)
    np.testing.assert_allclose(moved.twist, piece.twist, atol=1e-11)


def test_a_piece_of_one_state_takes_the_new_one() -> None:
    rng = np.random.default_rng(1)
    old, new = (ends(rng, 1.0, 0.3)[:1] for _ in range(2))
    assert np.array_equal(correct_final_states(old, new).T_world_cam, new.T_world_cam)


def path(rng: np.random.Generator, t: np.ndarray) -> States:
    return States(t, se3_exp(rng.normal(size=(len(t), 6))), rng.normal(size=(len(t), 6)))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 999), st.floats(-1.0, 0.9), st.floats(0, 1.0))
def test_poses_take_a_linear_share_of_a_correction_and_twists_follow(
    seed: int, start: float, size: float
) -> None:
    rng = np.random.default_rng(seed)
    states = path(rng, np.linspace(0, 1, 9))
    xi = size * rng.normal(size=6)
    end = States(states.t[-1:], se3_exp(xi) @ states.T_world_cam[-1:], rng.normal(size=(1, 6)))
    moved = share_correction(states, start, end)
    share = np.maximum(states.t - start, 0) / (1 - start)
    correction = se3_log(se3_exp(xi))  # turned by less than pi
    expected = se3_exp(share[:, None] * correction) @ states.T_world_cam
    np.testing.assert_allclose(moved.T_world_cam, expected, atol=1e-12)

    step = np.where(states.t >= start, 1e-6, 0.0)  # T(t + step) with the same body twist
    ahead = se3_exp((share + step / (1 - start))[:, None] * correction) @ states.T_world_cam
    velocity = se3_log(se3_inverse(expected) @ ahead) / 1e-6
    np.testing.assert_allclose(moved.twist - states.twist, velocity, atol=1e-5)


def test_states_are_final_when_they_have_settled() -> None:
    rng, final = np.random.default_rng(2), FinalStates(settling=0.3)
    kept: list[States] = []
    for k in range(10):
        piece, end = path(rng, np.linspace(0.1 * k, 0.1 * (k + 1), 5)), path(rng, np.zeros(1))
        final.extend(piece, States(piece.t[-1:], end.T_world_cam, end.twist))
        kept.append(final.after(-np.inf))
        assert (final.settling.t >= 0.1 * (k + 1) - 0.3 - 1e-9).all()
        assert np.array_equal(States.concatenate(final.parts).t[::4], 0.1 * np.arange(k + 1))
    for before, now in pairwise(kept):
        assert np.array_equal(now.T_world_cam[: len(before)], before.T_world_cam)
        assert np.array_equal(now.twist[: len(before)], before.twist)
    assert len(kept[-1]) >= 4 * 6
    final.end_segment(path(rng, np.array([1.0, 1.1])))
    assert len(final.settling) == 0 and final.after(0.9).t.tolist()[-2:] == [1.0, 1.1]


def test_no_more_memory_is_held_than_states() -> None:
    """Views of the final ones held the settling states of each moment, five pieces of them."""
    rng, final = np.random.default_rng(3), FinalStates(settling=0.5)
    tracemalloc.start()
    for begin in 0.1 * np.arange(60):
        piece = path(rng, begin + np.linspace(0, 0.1, 50))
        final.extend(piece, piece[-1:])
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert 59 * 49 * 184 <= final.nbytes < held < 1.3 * final.nbytes


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 999), st.floats(-0.5, 1.5))
def test_guessed_states_lead_to_the_one_that_was_found(seed: int, since: float) -> None:
    """Those before are as they were, and those after go where they went if that is found."""
    rng = np.random.default_rng(seed)
    states, t = path(rng, np.linspace(0, 1, 9)), np.array([1.2])
    guessed = states.at(t)
    xi = 0.3 * rng.normal(size=6)
    moved = led_to(states, since, States(t, se3_exp(xi) @ guessed.T_world_cam, guessed.twist))
    known = states.t <= since
    np.testing.assert_allclose(moved[known].T_world_cam, states[known].T_world_cam, atol=1e-12)
    share = 1.0 if since >= 1.0 else 0.2 / (1.2 - max(since, 0.0))  # that is left at the last one
    missing = se3_log(se3_exp(xi) @ states.T_world_cam[-1] @ se3_inverse(moved.T_world_cam[-1]))
    np.testing.assert_allclose(missing, share * xi, atol=1e-9)
    same = led_to(states, since, guessed)
    np.testing.assert_allclose(same.T_world_cam, states.T_world_cam, atol=1e-12)
    np.testing.assert_allclose(same.twist, states.twist, atol=1e-11)
