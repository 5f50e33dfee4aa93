"""The motion priors of the window have the Q_c that is known now, one between two neighbours."""

from __future__ import annotations

from itertools import pairwise

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import V, X
from runs import NOTHING

from benchmarks.simulated_tracklets import TrackletSimulation
from factors import WnoaPriorFactor
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator import FixedLagSmoother

STEADY = NoiseConfig(track_drift=0.0, motion_memory=0.5)
LIVELY = STEADY.model_copy(
    update={"acceleration_psd": tuple(100 * x for x in STEADY.acceleration_psd)}
)


def priors(smoother: FixedLagSmoother) -> list[WnoaPriorFactor]:
    """The WNOA priors in GTSAM's graph, in order of time."""
    graph = smoother.graph
    found = [graph.at(i) for i in range(graph.size())]
    of_motion = [factor for factor in found if isinstance(factor, WnoaPriorFactor)]
    return sorted(of_motion, key=lambda factor: list(factor.keys()))


def between_neighbours(smoother: FixedLagSmoother) -> list[list[int]]:
    """Keys of each state in the window and the next."""
    return [[X(i), V(i), X(j), V(j)] for i, j in pairwise(smoother.window)]


def moved(noise: NoiseConfig, given: NoiseConfig, missing: range = range(0)) -> FixedLagSmoother:
    """A smoother of 1 s of motion with one noise, that was given another; clusters may be empty."""
    simulation, rng = TrackletSimulation(noise, per_cluster=12), np.random.default_rng(3)
    smoother = FixedLagSmoother(simulation.camera, given, EstimatorConfig(bridge=0.3))
    for number, (end_time, new) in enumerate(simulation.clusters(simulation.motion(1.0, rng), rng)):
        used = smoother.noise.acceleration_psd
        smoother.update(end_time, NOTHING if number in missing else new)
        keys = between_neighbours(smoother)
        assert [list(prior.keys()) for prior in priors(smoother)] == keys
        if not missing and number > 1:
            learned = smoother.noise.acceleration_psd
            for prior in priors(smoother):
                np.testing.assert_array_equal(prior.qc, learned)
            assert (learned != used) == (given.motion_memory > 0)
    return smoother


def test_all_priors_in_the_window_follow_what_is_learned() -> None:
    smoother = moved(LIVELY, STEADY)
    assert min(smoother.noise.acceleration_psd[:1]) > 10 * STEADY.acceleration_psd[0]
    assert not smoother.diagnostics


def test_given_noise_stays_that_of_all_priors() -> None:
    given = LIVELY.model_copy(update={"motion_memory": 0.0})
    assert moved(LIVELY, given).noise == given


@pytest.mark.parametrize("missing", [range(5, 8), range(5, 15)])
def test_states_that_nothing_measures_have_one_prior_each(missing: range) -> None:
    assert not moved(STEADY, STEADY, missing).diagnostics


def test_a_smoother_that_is_made_again_has_one_prior_each() -> None:
    """A factor of a user's own that cannot be used makes GTSAM's smoother fail."""
    simulation, rng = TrackletSimulation(STEADY, per_cluster=30), np.random.default_rng(3)
    smoother = FixedLagSmoother(simulation.camera, STEADY)
    for number, (end_time, new) in enumerate(simulation.clusters(simulation.motion(1.0, rng), rng)):
        if number == 8:
            broken = gtsam.noiseModel.Isotropic.Sigma(6, 1e-200)
            smoother.add(gtsam.PriorFactorVector(V(smoother.window[-1]), np.ones(6), broken))
        smoother.update(end_time, new)
        keys = between_neighbours(smoother)
        assert [list(prior.keys()) for prior in priors(smoother)] == keys
    assert smoother.diagnostics
