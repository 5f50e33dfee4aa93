"""Pieces of a trajectory meet without a jump, and move no more than the process says."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from factors.lie import se3_exp
from gpvo.estimator.final_states import correct_final_states
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
