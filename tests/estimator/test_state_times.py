"""When states are: at unique times, or at key times that the prior's stiffness sets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from runs import NOTHING, PERIOD, make, regular
from synthetic import CAMERA, tracklets

from factors import wnoa_covariance
from gpvo import FixedLagSmoother
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator.state_times import (
    SAME_TIME,
    STIFFNESS,
    key_interval,
    key_times,
    state_times,
)

NOISE = NoiseConfig()


@settings(deadline=None)
@given(
    arrays(np.float64, st.integers(0, 40), elements=st.floats(0, 1, width=32)),
    st.sampled_from([0.0, 1e-3, 0.1]),
    st.sampled_from([-np.inf, 0.0, 0.5]),
)
def test_state_times(t: np.ndarray, interval: float, after: float) -> None:
    states = state_times(t, interval, after)
    assert np.isin(states, t).all()
    gaps = np.diff(states, prepend=after)
    assert (gaps > SAME_TIME).all()
    assert (gaps[:-1] > interval).all()
    if len(t) and t.max() - after > SAME_TIME:
        assert t.max() - states[-1] <= SAME_TIME
    inside = t[t > after]
    if len(inside) and len(states):  # no measurement is farther from a state before it than this
        before = np.concatenate([[max(after, inside.min() - SAME_TIME)], states])
        nearest = inside - before[np.searchsorted(before, inside, "right") - 1]
        assert (nearest <= max(interval, SAME_TIME) + 1e-12).all()


@settings(deadline=None, max_examples=60)
@given(
    st.floats(0, 10),
    st.lists(st.floats(0, 20), max_size=5),
    st.floats(0, 12),
    st.sampled_from([0.01, 0.025, 1.0]),
)
def test_key_times(last: float, measured: list[float], ahead: float, interval: float) -> None:
    """An interval or less apart, except in a gap, at whose ends alone there is one."""
    stop = last + ahead
    seen = np.array([t for t in measured if t <= stop])
    t = key_times(last, seen, stop, interval)
    steps, starts = np.diff(t, prepend=last), np.append(last, t)[: len(t)]
    assert (steps > SAME_TIME).all()
    if ahead > 1e-6:
        assert t[-1] == pytest.approx(stop)
    points = np.unique(np.concatenate([[last], seen[seen > last], [stop]]))
    for start, step in zip(starts, steps, strict=True):
        if step > interval * (1 + 1e-5):
            assert np.abs(points - start).min() < 2 * SAME_TIME
            assert np.abs(points - (start + step)).min() < 2 * SAME_TIME
            inside = (points > start + 2 * SAME_TIME) & (points < start + step - 2 * SAME_TIME)
            assert not inside.any()


def test_a_gap_has_key_states_at_its_ends_alone() -> None:
    measured = np.array([1.02, 1.04, 4.1, 4.12, 4.14, 4.16])
    t = key_times(1.0, measured, 4.18, 0.04)
    assert np.allclose(t, [1.04, 4.1, 4.14, 4.18])


@pytest.mark.parametrize("interval", [1.0, 1e5, 1e300])
def test_the_end_has_a_key_state_however_long_the_interval(interval: float) -> None:
    assert key_times(1.0, np.array([1.02]), 1.05, interval).tolist() == [1.05]


def noise_of(rotation: float, translation: float, information: float = 1.0) -> NoiseConfig:
    """Noise with a Q_c of equal parts and equal information of u and v."""
    psd = (rotation,) * 3 + (translation,) * 3
    return NoiseConfig(acceleration_psd=psd, measurement_information=(information,) * 2 + (0.1,))


@pytest.mark.parametrize("disparity", [2.0, 15.0])
@pytest.mark.parametrize("part", ["rotation", "translation", "both"])
def test_key_interval_halves_when_the_density_is_eight_times_larger(
    disparity: float, part: str
) -> None:
    """Of what matters: no disparity of an image that turns only is too large."""
    rotation, translation = (0.02, 0.2) if part == "both" else (0.02, 1e-12)
    if part == "translation":
        rotation, translation = 1e-12, 0.2
    once = key_interval(noise_of(rotation, translation), CAMERA, disparity)
    eight = key_interval(noise_of(8 * rotation, 8 * translation), CAMERA, disparity)
    assert eight == pytest.approx(once / 2)


def test_key_interval_halves_when_measurements_are_eight_times_as_precise() -> None:
    once = key_interval(noise_of(0.02, 0.2, 0.5), CAMERA, 10.0)
    eight = key_interval(noise_of(0.02, 0.2, 4.0), CAMERA, 10.0)
    assert eight == pytest.approx(once / 2)


def test_key_interval_is_shorter_for_what_is_near_or_seen_by_a_longer_lens() -> None:
    turning, shifting = noise_of(0.02, 1e-12), noise_of(1e-12, 0.2)
    lens = replace(CAMERA, fx=8**0.5 * CAMERA.fx, fy=8**0.5 * CAMERA.fy)
    wide, narrow = (key_interval(turning, x, 10.0) for x in (CAMERA, lens))
    assert narrow == pytest.approx(wide / 2)
    far, near = (key_interval(shifting, CAMERA, x) for x in (10.0, 8**0.5 * 10.0))
    assert near == pytest.approx(far / 2)


def test_key_interval_leaves_the_stiffness_half_way() -> None:
    """Given states an interval apart, the pixel that the prior leaves is that share of one."""
    noise = noise_of(1e-12, 0.3, 4.0)
    dt = key_interval(noise, CAMERA, 12.0)
    joint = np.zeros((24, 24))
    half = wnoa_covariance(dt / 2, noise.acceleration_psd)
    phi = np.eye(12) + dt / 2 * np.eye(12, k=6)
    joint[:12, :12], joint[12:, :12], joint[:12, 12:] = half, phi @ half, half @ phi.T
    joint[12:, 12:] = phi @ half @ phi.T + half
    left = joint[:12, :12] - joint[:12, 12:] @ np.linalg.solve(joint[12:, 12:], joint[12:, :12])
    pixels = np.sqrt(left[3, 3]) * 12.0 / CAMERA.baseline
    assert pixels * np.sqrt(4.0) == pytest.approx(STIFFNESS)


def test_key_states_are_at_the_clusters_ends_where_the_prior_is_stiff() -> None:
    estimator = make(window=4)
    assert isinstance(estimator, FixedLagSmoother)
    for end_time, part in regular(tracklets(clusters=7, noise=0.3)):
        estimator.update(end_time, part)
    assert np.allclose(np.diff(estimator.window_times), PERIOD)
    assert estimator.window_times[-1] == pytest.approx(7 * PERIOD)
    assert len(estimator.window) == len(estimator.window_times)


@pytest.mark.parametrize("factor", [1.0, 30.0, 1000.0])
def test_key_states_are_nearer_where_the_prior_is_loose(factor: float) -> None:
    """As near as the rule has it, for the median disparity; and unique times stay states."""
    noise = NoiseConfig(acceleration_psd=tuple(factor * x for x in NOISE.acceleration_psd))
    estimator = FixedLagSmoother(CAMERA, noise, EstimatorConfig(window=3))
    parts = tracklets(clusters=6, per_cluster=30, noise=0.3)  # gaps are shorter than intervals
    for end_time, part in regular(parts):
        estimator.update(end_time, part)
    longest = min(PERIOD, key_interval(noise, CAMERA, np.median(parts[-1].stereo[:, 2])))
    steps = np.diff(estimator.window_times[estimator.window_times >= 5 * PERIOD - 1e-9])
    assert steps.max() <= longest * (1 + 1e-6)
    assert steps.min() > 0.5 * longest
    assert np.isin(estimator.window_times, estimator.states.t).all()
    inside = np.unique(parts[4].t)
    assert np.isin(inside, estimator.states.t).mean() > 0.7


@pytest.mark.parametrize("interval", [0.01, 0.025, 0.1])
def test_key_states_are_as_far_apart_as_the_configuration_says(interval: float) -> None:
    estimator = make(window=3, state_interval=interval)
    assert isinstance(estimator, FixedLagSmoother)
    for end_time, part in regular([*tracklets(5, per_cluster=30, noise=0.3), NOTHING]):
        estimator.update(end_time, part)
    steps = np.diff(estimator.window_times)
    assert steps[-1] == pytest.approx(PERIOD)  # nothing is measured
    assert steps[:-1].max() <= min(interval, PERIOD) * (1 + 1e-6)
