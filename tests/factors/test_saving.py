"""A graph that was saved and read again is the same graph."""

from __future__ import annotations

import json
from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import CAMERA, NOISE, QC
from gtsam.symbol_shorthand import L, V, X
from test_manners import FACTORS, MEASURED, STATES, good_values

from factors import (
    InterpolatedStereoFactor,
    LandmarkPrior,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    from_dict,
    original,
    to_dict,
)
from factors.lie import se3_exp

ROBUST = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(2.0), NOISE)


def graph() -> gtsam.NonlinearFactorGraph:
    """All factors of ours, with robust and mounted ones, some of GTSAM's, and an empty slot."""
    found = gtsam.NonlinearFactorGraph()
    for make in FACTORS.values():
        found.add(make())
    A = np.random.default_rng(0).normal(size=(6, 6))
    found.add(WnoaPriorFactor(*STATES, A @ A.T + np.eye(6)))
    mounted = se3_exp([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    rest = L(0), CAMERA, 0.03, None, mounted
    found.add(InterpolatedStereoFactor(MEASURED, ROBUST, *STATES, *rest))
    data = [MEASURED] * 3, [0.01, 0.02, 0.05], 0
    prior = LandmarkPrior.none()
    found.add(StructurelessStereoFactor(*data, ROBUST, STATES, CAMERA, QC, prior))
    found.add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 0.1)))
    gaussian = gtsam.noiseModel.Gaussian.Covariance(A @ A.T + np.eye(6))
    found.add(gtsam.BetweenFactorPose3(X(0), X(1), gtsam.Pose3(), gaussian))
    found.push_back(None)
    found.add(gtsam.PriorFactorVector(V(0), np.zeros(6), gaussian))
    return found


def test_a_graph_saved_as_json_is_the_same_graph() -> None:
    before, values = graph(), good_values()
    after = from_dict(json.loads(json.dumps(to_dict(before))))
    assert after.size() == before.size()
    for i in range(before.size()):
        one, other = before.at(i), after.at(i)
        if one is None:
            assert other is None
            continue
        ours = original(one)
        assert ours.equals(other) if ours is not None else one.equals(other, 1e-12)
        np.testing.assert_array_equal(
            other.linearize(values).augmentedJacobian(), one.linearize(values).augmentedJacobian()
        )


def test_what_cannot_be_saved_is_named() -> None:
    one = gtsam.NonlinearFactorGraph()
    one.add(FACTORS["prior"]())
    unit = gtsam.noiseModel.Unit.Create(1)
    one.add(gtsam.CustomFactor(unit, [X(0)], lambda *_: np.zeros(1)))
    with pytest.raises(ValueError, match="factor 1 cannot be saved"):
        to_dict(one)


@pytest.mark.parametrize(
    "description",
    [
        {},
        {"factors": 3},
        {"factors": [{"type": "system", "with": {}}]},
        {"factors": [{"type": "WnoaPriorFactor", "with": {"dt": 1.0}}]},
        {"factors": [{"gtsam": "no.such", "text": ""}]},
        {"factors": [{"gtsam": "os.system", "text": "true"}]},
        {"factors": [{"gtsam": "ConcentratedGaussianVector", "text": ""}]},
        {"factors": [{"type": "optimize", "with": {"graph": None, "values": None}}]},
    ],
)
def test_other_descriptions_are_refused(description: Any) -> None:
    with pytest.raises(ValueError, match=r"description|makes no"):
        from_dict(description)


@pytest.mark.parametrize("sigma", [np.inf, np.nan])
def test_numbers_that_cannot_be_read_again_are_not_saved(sigma: float) -> None:
    one = gtsam.NonlinearFactorGraph()
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.r_[1.0, 1.0, sigma])
    factor = InterpolatedStereoFactor(MEASURED, noise, *STATES, L(0), CAMERA, 0.03)
    one.add(factor)
    with pytest.raises(ValueError, match=r"factor 0 cannot be saved: .* infinite"):
        to_dict(one)


def test_a_factor_that_only_has_a_prior_can_be_saved() -> None:
    before = gtsam.NonlinearFactorGraph()
    nothing = np.empty((0, 3)), np.empty(0), np.empty(0, np.int64)
    factor = StructurelessStereoFactor(*nothing, NOISE, STATES, CAMERA, QC, LandmarkPrior.none())
    before.add(factor)
    after = from_dict(json.loads(json.dumps(to_dict(before))))
    assert factor.equals(after.at(0))
