"""The covariance between states is that of a graph with the state put in, to 60 digits."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest
from graphs import QC, durations, random_states, seeds, state
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from test_oracle import Oracle, block_diagonal, oracle, relative_difference  # noqa: F401

from factors import extrapolate, interpolate, wnoa_square_root_information
from factors.lie import se3_exp
from factors.wnoa import wnoa_error

Array = NDArray[np.float64]
State = tuple[Array, Array]
ENDS, MIDDLE = np.r_[:12, 24:36], np.r_[12:24]


def whitened_prior(i: State, j: State, dt: float, qc: Array) -> Array:
    """(12, 24) derivative of the prior's whitened error by two states dt apart."""
    return wnoa_square_root_information(dt, qc) @ wnoa_error(*i, *j, dt)[1]


def two_steps(i: State, j: State, dt: float, to: float, qc: Array) -> Array:
    """(24, 36) derivative of the priors to the state between, `to` after i, and on to state j."""
    between = interpolate(*i, *j, 0.0, dt, to)[:2]
    rows = np.zeros((24, 36))
    rows[:12, :24] = whitened_prior(i, between, to, qc)
    rows[12:, 12:] = whitened_prior(between, j, dt - to, qc)
    return rows


def with_state(own: Array, steps: Array) -> Array:
    """(36, 36) covariance of states i, the one between, and j; `own` (n, 24) is all but priors."""
    spread = np.zeros((len(own), 36))
    spread[:, ENDS] = own
    return inverse_information(np.vstack([spread, steps]))


def inverse_information(J: Array) -> Array:
    """(JᵀJ)^-1 in decimals of 60 digits, rounded at the end."""
    with localcontext() as context:
        context.prec = 60
        rows = np.vectorize(Decimal, otypes=[object])(J)
        n = J.shape[1]
        table = np.hstack([rows.T @ rows, np.vectorize(Decimal, otypes=[object])(np.eye(n))])
        for k in range(n):
            table[k] = table[k] / table[k, k]
            for i in range(n):
                if i != k:
                    table[i] = table[i] - table[i, k] * table[k]
        return table[:, n:].astype(np.float64)


def test_covariance_is_that_of_a_graph_with_the_state_put_in(oracle: Oracle) -> None:  # noqa: F811
    """All oracle cases, 10 us among them."""
    i, j = (oracle.T_i, oracle.v_i), (oracle.T_j, oracle.v_j)
    own = np.linalg.cholesky(np.linalg.inv(oracle.prior_covariance)).T
    whole = with_state(own, two_steps(i, j, oracle.dt, oracle.tau, oracle.qc))
    joint = whole[np.ix_(ENDS, ENDS)]
    found = interpolate(*i, *j, 0.0, oracle.dt, oracle.tau, oracle.qc, joint).covariance
    assert found is not None
    assert np.linalg.eigvalsh(found)[0] > 0
    # Half a unit in the last place of the joint covariance already makes 4e-16 / dt^2.
    tolerance = max(1e-11, 2e-15 * oracle.dt**-2)
    assert relative_difference(found, whole[np.ix_(MIDDLE, MIDDLE)]) < tolerance


@pytest.mark.parametrize("seed", range(3))
def test_a_joint_without_the_state_serves_to_second_order(seed: int) -> None:
    """One prior over dt and two over its parts differ by less, the shorter dt is.

    In the sharpest direction, at constant acceleration: thousandths at 0.1 s, 1e-4 at 25 ms.
    """
    own = np.diag(np.full(24, 10.0))  # 0.1 rad, m, rad/s and m/s on both states
    differences = []
    for dt in (0.1, 0.05, 0.025):
        i, j = accelerated(seed, dt)
        joint = inverse_information(np.vstack([own, whitened_prior(i, j, dt, QC)]))
        found = interpolate(*i, *j, 0.0, dt, 0.3 * dt, QC, joint).covariance
        whole = with_state(own, two_steps(i, j, dt, 0.3 * dt, QC))
        differences.append(sharpest(found, whole[np.ix_(MIDDLE, MIDDLE)]))
    order = np.log2(np.divide(differences[:-1], differences[1:]))
    np.testing.assert_allclose(order, 2, atol=0.15)
    assert differences[0] < 5e-3


@pytest.mark.parametrize("dt", [0.4, 0.05])
def test_only_the_prior_tells_the_joint_without_the_state_from_that_with_it(dt: float) -> None:
    """Its information exchanged for that of the two steps, they are the same."""
    i, j = accelerated(0, dt)
    own, one = np.diag(np.full(24, 10.0)), whitened_prior(i, j, dt, QC)
    steps = two_steps(i, j, dt, 0.3 * dt, QC)
    Q, _ = np.linalg.qr(steps[:, MIDDLE], mode="complete")
    both = Q[:, 12:].T @ steps[:, ENDS]  # without the state between
    without = np.linalg.inv(inverse_information(np.vstack([own, one])))
    exchanged = np.linalg.inv(without - one.T @ one + both.T @ both)
    whole = with_state(own, steps)[np.ix_(ENDS, ENDS)]
    np.testing.assert_allclose(exchanged, whole, atol=1e-9 * np.abs(whole).max())


def accelerated(seed: int, dt: float) -> tuple[State, State]:
    """States dt apart of a motion of about 1 rad/s, 1 m/s, and constant acceleration."""
    velocity, acceleration = np.random.default_rng(seed).normal(size=(2, 6))
    T_j = se3_exp(dt * velocity + dt**2 / 2 * acceleration)
    return (np.eye(4), velocity), (T_j, velocity + dt * acceleration)


def sharpest(covariance: Array | None, reference: Array) -> float:
    """Largest relative difference of the variance in any direction."""
    assert covariance is not None
    inverse = np.linalg.inv(np.linalg.cholesky(reference))
    return float(np.abs(np.linalg.eigvalsh(inverse @ (covariance - reference) @ inverse.T)).max())


@given(seeds, durations, st.floats(0.001, 0.999))
@settings(deadline=None, max_examples=15)
def test_covariances_are_positive_semidefinite(seed: int, dt: float, share: float) -> None:
    values = random_states(seed, dt)
    A = np.random.default_rng(seed).normal(size=(24, 24))
    joint = A @ A.T
    between = interpolate(
        *state(values, 0), *state(values, 1), 0.0, dt, share * dt, QC, joint
    ).covariance
    beyond = extrapolate(*state(values, 0), np.array([dt, -dt, 0]), QC, joint[:12, :12]).covariance
    for covariance in (between, *beyond):
        assert_semidefinite(covariance)
    np.testing.assert_array_equal(beyond[2], joint[:12, :12])


def assert_semidefinite(covariance: Array) -> None:
    """No eigenvalue of the correlation matrix is negative beyond rounding."""
    np.testing.assert_array_equal(covariance, covariance.T)
    sigmas = np.sqrt(np.diag(covariance))
    assert np.linalg.eigvalsh(covariance / np.outer(sigmas, sigmas))[0] > -1e-13
