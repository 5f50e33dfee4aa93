"""The velocity that the motion goes on with: the measured one, corrected where few measure it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpvo.mc_ransac import VelocityFit, fused_velocity, trusted_velocity
from gpvo.mc_ransac.fusion import MEASURED
from gpvo.trajectory import MotionEstimate

TWIST, ACCELERATION, QC = np.arange(6.0), np.full(6, -2.0), np.full(6, 0.5)
COVARIANCE = 0.01 * np.eye(12)
BEFORE = MotionEstimate(1.0, np.eye(4), TWIST, COVARIANCE, QC, ACCELERATION)


def fit_of(velocity: float, variance: float, count: int) -> VelocityFit:
    return VelocityFit(np.full(6, velocity), variance * np.eye(6), np.ones(count, bool))


def test_it_weighs_by_covariance() -> None:
    predicted, fit = np.zeros(6), fit_of(1.0, 1.0, 0)
    assert np.allclose(fused_velocity(predicted, np.eye(6), fit), 0.5)
    assert np.allclose(fused_velocity(predicted, 1e12 * np.eye(6), fit), 1.0)
    assert np.allclose(fused_velocity(predicted, 1e-12 * np.eye(6), fit), 0.0)
    assert np.array_equal(fused_velocity(predicted, np.eye(6), None), predicted)


def test_enough_segments_tell_it_alone() -> None:
    fit = fit_of(7.0, 1e-4, MEASURED)
    assert np.array_equal(trusted_velocity(fit, BEFORE, 1.1), fit.velocity)
    few = fit_of(7.0, 1e-4, MEASURED - 1)
    assert not np.array_equal(trusted_velocity(few, BEFORE, 1.1), few.velocity)


@pytest.mark.parametrize("count", [0, 4, MEASURED - 1])
def test_few_segments_correct_what_is_expected(count: int) -> None:
    expected = TWIST + 0.1 * ACCELERATION
    assert np.allclose(trusted_velocity(None, BEFORE, 1.1), expected)
    as_certain = VelocityFit(
        np.full(6, 7.0), BEFORE.at(1.1).covariance[6:, 6:], np.ones(count, bool)
    )
    assert np.allclose(trusted_velocity(as_certain, BEFORE, 1.1), 0.5 * (expected + 7.0))
    wild = fit_of(70.0, 1e4, count)
    assert np.allclose(trusted_velocity(wild, BEFORE, 1.1), expected, atol=1e-3)


def test_it_is_weighed_by_the_covariance_that_the_prior_has() -> None:
    few = fit_of(7.0, 1e-2, 4)
    scaled = replace(BEFORE, covariance=9.0 * COVARIANCE, white_covariance=COVARIANCE)
    expected = trusted_velocity(few, BEFORE, 1.1)
    assert np.array_equal(trusted_velocity(few, scaled, 1.1), expected)


def test_nothing_is_expected_before_the_first_estimate() -> None:
    few = fit_of(7.0, 1e-4, 1)
    assert np.array_equal(trusted_velocity(few, None, 1.1), few.velocity)
    assert np.array_equal(trusted_velocity(None, None, 1.1), np.zeros(6))


def test_a_time_before_the_estimate_is_its_own() -> None:
    assert np.allclose(trusted_velocity(None, BEFORE, 0.9), TWIST)
