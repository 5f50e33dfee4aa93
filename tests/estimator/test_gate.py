"""The gate: what lies too far from its prediction is left out and listed, by the right share."""

from __future__ import annotations

import numpy as np
import pytest
from runs import METHODS, POINTS, fed, make, regular
from synthetic import TWIST, tracklets

from benchmarks.simulated_tracklets import TrackletSimulation
from factors import StructurelessStereoFactor
from gpvo.config import EstimatorConfig
from gpvo.estimator import make_estimator

INTERVALS = (0.0, 0.025)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("interval", INTERVALS)
def test_the_gate_keeps_wrong_measurements_out_and_lists_them(method: str, interval: float) -> None:
    """Of landmarks that are known by then; those that are right come in."""
    parts = tracklets(clusters=7, per_cluster=10, noise=0.3)
    known, count = np.unique(np.concatenate([p.landmark for p in parts[:4]]), return_counts=True)
    wrong = [np.isin(part.landmark, known[count >= 2][::2]) for part in parts[4:]]
    for part, mask in zip(parts[4:], wrong, strict=True):
        part.stereo[mask, :2] += 40.0
    values = {tuple(x) for p, m in zip(parts[4:], wrong, strict=True) for x in p.stereo[m].tolist()}
    estimator = make(gate=0.9999, method=method, state_interval=interval)
    gated, diagnostics = fed(estimator, regular(parts)), estimator.diagnostics
    assert {found.measurement for found in diagnostics if "gate" in found.reason} == values
    assert np.abs(gated.velocity(gated.t) - TWIST).max() < 0.1


@pytest.mark.parametrize(
    "method, interval", [("fixed_lag", 0.0), ("fixed_lag", 0.1), ("batch", 0.025)]
)
def test_the_gate_lets_the_configured_share_in(
    monkeypatch: pytest.MonkeyPatch, method: str, interval: float
) -> None:
    """Of measurements of known landmarks, where motion and noise are what is assumed."""
    found: list[np.ndarray] = []
    squared_distances = StructurelessStereoFactor.squared_distances

    def spied(factor: StructurelessStereoFactor, *arguments: object) -> np.ndarray:
        found.append(squared_distances(factor, *arguments))  # type: ignore[arg-type]
        return found[-1]

    monkeypatch.setattr(StructurelessStereoFactor, "squared_distances", spied)
    config = EstimatorConfig(gate=0.9, method=method, state_interval=interval)  # type: ignore[arg-type]
    left_out = 0
    for seed in range(4):
        rng, simulation = np.random.default_rng(seed), TrackletSimulation(POINTS, 6)
        motion = simulation.motion(0.5, rng)
        estimator = make_estimator(simulation.camera, POINTS, config)
        fed(estimator, simulation.clusters(motion, rng))
        left_out += len(estimator.diagnostics)
        assert all("gate" in diagnostic.reason for diagnostic in estimator.diagnostics)
    known = np.isfinite(np.concatenate(found)).sum()
    assert known > 300
    assert 0.06 < left_out / known < 0.15


@pytest.mark.parametrize("method", METHODS)
def test_all_is_taken_where_there_is_no_prediction(
    monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    def singular(*_: object) -> np.ndarray:
        raise np.linalg.LinAlgError("Matrix is not positive definite")

    monkeypatch.setattr(StructurelessStereoFactor, "squared_distances", singular)
    clusters = regular(tracklets(clusters=6, noise=0.3))
    gated = fed(make(gate=0.9, method=method, state_interval=0.025), clusters)
    plain = fed(make(method=method, state_interval=0.025), clusters)
    assert np.array_equal(gated.T_world_cam, plain.T_world_cam)
