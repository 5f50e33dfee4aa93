"""States between two others: their covariance, and the few variables that stand for it."""

from __future__ import annotations

import numpy as np
from graphs import durations, seeds
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from factors import wnoa_covariance
from factors.structureless.bridge import Bridge, bridge_covariance, pivoted_cholesky_kernel

Array = NDArray[np.float64]

examples = settings(deadline=None, max_examples=20, derandomize=True)
counts = st.integers(1, 12)


def times_within(seed: int, duration: float, count: int) -> Array:
    """Times in random order, no two of them closer than a fiftieth of the duration."""
    rng = np.random.default_rng(seed)
    share = (rng.permutation(count) + rng.uniform(0.2, 0.8, count)) / count
    return duration * share


def unit(duration: float) -> Array:
    """Scale (2,) of deviations of xi and of w."""
    return np.array([duration**1.5, duration**0.5])


def flat(covariance: Array) -> Array:
    """(2 m, 2 n) of (2, 2, m, n)."""
    m, n = covariance.shape[2:]
    return covariance.transpose(0, 2, 1, 3).reshape(2 * m, 2 * n)


def without_units(covariance: Array, duration: float) -> Array:
    return covariance / np.multiply.outer(unit(duration), unit(duration))[:, :, None, None]


def chain_covariance(times: Array, duration: float) -> Array:
    """(2, 2, n, n) of a chain of WNOA steps from a known state, then given the state at the end."""
    order = np.argsort(times)
    t = np.concatenate([[0.0], times[order], [duration]])
    whole = np.zeros((2 * len(t), 2 * len(t)))
    for k in range(1, len(t)):
        dt = t[k] - t[k - 1]
        step = np.array([[1.0, dt], [0.0, 1.0]])
        own, before = slice(2 * k, 2 * k + 2), slice(2 * k - 2, 2 * k)
        whole[own, : 2 * k] = step @ whole[before, : 2 * k]
        whole[: 2 * k, own] = whole[own, : 2 * k].T
        whole[own, own] = step @ whole[before, before] @ step.T
        whole[own, own] += wnoa_covariance(dt, np.ones(6))[::6, ::6]
    middle, end = slice(2, -2), slice(-2, None)
    given_end = whole[middle, middle] - whole[middle, end] @ np.linalg.solve(
        whole[end, end], whole[end, middle]
    )
    sorted_by_time = given_end.reshape(len(times), 2, len(times), 2).transpose(1, 3, 0, 2)
    back = np.argsort(order)
    return sorted_by_time[:, :, back][:, :, :, back]


@given(seeds, durations, counts)
@examples
def test_covariance_is_that_of_a_chain_given_both_ends(
    seed: int, duration: float, count: int
) -> None:
    times = times_within(seed, duration, count)
    found = without_units(bridge_covariance(times, times, duration), duration)
    expected = without_units(chain_covariance(times, duration), duration)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


@given(seeds, durations, counts)
@examples
def test_as_many_variables_as_times_are_exact(seed: int, duration: float, count: int) -> None:
    times = times_within(seed, duration, count)
    bridge = Bridge.through(times, duration, np.ones(count), 0.0)
    assert bridge.rank == count
    np.testing.assert_array_equal(np.sort(bridge.pivots), np.sort(times))
    expected = bridge_covariance(times, times, duration)[0, 0]
    found = bridge.gains @ bridge.gains.T
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15 * duration**3)
    np.testing.assert_allclose(np.diag(found), np.diag(expected), rtol=1e-9)


@given(seeds, durations, counts, st.floats(-8, 0))
@examples
def test_what_is_neglected_is_within_the_tolerance(
    seed: int, duration: float, count: int, exponent: float
) -> None:
    """Weighted by how much it shows in a measurement; and the pivots are as few as needed."""
    times, rng = times_within(seed, duration, count), np.random.default_rng(seed)
    scale = 10 ** rng.uniform(-2, 2, count) / duration**3
    tolerance = 10.0**exponent
    bridge = Bridge.through(times, duration, scale, tolerance)
    exact = bridge_covariance(times, times, duration)[0, 0]
    left = exact - bridge.gains @ bridge.gains.T
    assert (scale * np.diag(left)).max() <= tolerance + 1e-12
    assert np.linalg.eigvalsh(left)[0] >= -1e-15 * duration**3
    if bridge.rank:
        fewer = exact - bridge.gains[:, :-1] @ bridge.gains[:, :-1].T
        assert (scale * np.diag(fewer)).max() > tolerance
    coarser = Bridge.through(times, duration, scale, 10 * tolerance)
    np.testing.assert_array_equal(coarser.pivots, bridge.pivots[: coarser.rank])


@given(seeds, durations, counts)
@examples
def test_deviations_are_the_weights_times_the_variables(
    seed: int, duration: float, count: int
) -> None:
    times, rng = times_within(seed, duration, count), np.random.default_rng(seed)
    bridge = Bridge.through(times, duration, np.full(count, duration**-3), 1e-6)
    u = rng.normal(size=(6, bridge.rank))
    others = np.concatenate([times, duration * rng.uniform(size=7), [0.0, duration]])
    found = bridge.deviations(others, u).reshape(-1, 2, 6)
    expected = np.einsum("hnr,cr->nhc", bridge.weights(others), u)
    scaled = unit(duration)[:, None]
    np.testing.assert_allclose(found / scaled, expected / scaled, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[: len(times), 0], bridge.gains @ u.T, atol=1e-9 * scaled[0, 0])
    at_ends = found[-2:] / scaled
    np.testing.assert_allclose(at_ends[:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(at_ends[:, 1], 0.0, atol=1e-9)


@given(seeds, durations, counts)
@examples
def test_weights_of_the_rates_are_the_derivatives_of_those_of_the_poses(
    seed: int, duration: float, count: int
) -> None:
    bridge = Bridge.through(times_within(seed, duration, count), duration, np.ones(count), 0.0)
    t = duration * np.random.default_rng(seed).uniform(0.05, 0.95, 9)
    step = 1e-5 * duration
    numerical = (bridge.weights(t + step)[0] - bridge.weights(t - step)[0]) / (2 * step)
    scale = unit(duration)[1] / np.sqrt(count)
    np.testing.assert_allclose(bridge.weights(t)[1], numerical, rtol=0, atol=1e-3 * scale)


@given(seeds, durations, counts)
@examples
def test_the_variables_leave_a_covariance(seed: int, duration: float, count: int) -> None:
    """Positive semidefinite, and without any deviation of the pose at the pivots."""
    times = times_within(seed, duration, count)
    bridge = Bridge.through(times, duration, np.full(count, duration**-3), 1e-6)
    other = duration * np.random.default_rng(seed).uniform(size=5)
    left = flat(without_units(bridge.left(np.concatenate([bridge.pivots, other])), duration))
    assert np.linalg.eigvalsh(0.5 * (left + left.T))[0] > -1e-12
    np.testing.assert_allclose(left[: bridge.rank], 0.0, atol=1e-11)


def test_nothing_is_left_out_of_a_bridge_without_deviations() -> None:
    bridge, times = Bridge.rigid(3, 0.1), np.array([0.01, 0.05, 0.09])
    assert bridge.rank == 0
    assert bridge.gains.shape == (3, 0)
    np.testing.assert_array_equal(bridge.deviations(times, np.empty((6, 0))), np.zeros((3, 12)))
    expected = bridge_covariance(times, times, 0.1)
    np.testing.assert_array_equal(bridge.left(times), expected)


@given(seeds, durations, counts)
@examples
def test_time_runs_either_way(seed: int, duration: float, count: int) -> None:
    """Backwards the twist has the other sign; the pose deviates to all digits by as much."""
    times = times_within(seed, duration, count)
    ahead = without_units(bridge_covariance(times, times, duration), duration)
    back = without_units(bridge_covariance(duration - times, duration - times, duration), duration)
    sign = np.array([[1, -1], [-1, 1]])[:, :, None, None]
    np.testing.assert_allclose(back, sign * ahead, rtol=0, atol=1e-14)
    gains, mirrored = (
        Bridge.through(t, duration, np.ones(count), 0.0).gains for t in (times, duration - times)
    )
    np.testing.assert_allclose(
        mirrored @ mirrored.T, gains @ gains.T, rtol=0, atol=1e-14 * duration**3
    )


@given(st.floats(1e-9, 1e-3), durations)
@examples
def test_near_a_state_the_deviation_keeps_its_digits(share: float, duration: float) -> None:
    """It is s^3 / 3 (1 - s)^3 of the duration's cube at the share s."""
    times = duration * np.array([share])
    found = Bridge.through(times, duration, np.ones(1), 0.0).gains[0, 0] ** 2
    share = times[0] / duration
    np.testing.assert_allclose(found, (share * (1 - share) * duration) ** 3 / 3, rtol=1e-12)


@given(seeds)
@settings(deadline=None, max_examples=3, derandomize=True)
def test_so_many_variables_as_are_needed_are_taken(seed: int) -> None:
    """More than there is room for to begin with."""
    times = times_within(seed, 1.0, 70)
    gains, pivots = pivoted_cholesky_kernel(times, 1.0, np.ones(70), 0.0)
    assert len(pivots) > 32
    found, expected = gains @ gains.T, bridge_covariance(times, times, 1.0)[0, 0]
    np.testing.assert_allclose(found, expected, atol=1e-12 * expected.max())
