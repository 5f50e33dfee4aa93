"""No input makes an estimator fail: what is impossible is left out, and what is wrong is told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import synthetic
from synthetic import CAMERA, TWIST, constant_velocity
from test_estimators import METHODS, NOTHING, PERIOD

from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.mc_ransac import VelocityFit
from gpvo.tracking import Measurements
from gpvo.trajectory import Trajectory

Cluster = tuple[float, Measurements]


def tracklets(clusters: int, per_cluster: int = 4, noise: float = 0.0) -> list[Measurements]:
    return synthetic.tracklets(clusters, per_cluster, noise)


def regular(parts: list[Measurements]) -> list[Cluster]:
    return [((frame + 1) * PERIOD, part) for frame, part in enumerate(parts)]


def changed(part: Measurements, stereo: np.ndarray) -> Measurements:
    return Measurements(part.landmark, part.frame, part.t, stereo)


def outliers(share: float, seed: int = 1) -> list[Cluster]:
    rng = np.random.default_rng(seed)
    parts = []
    for part in tracklets(clusters=7, per_cluster=10, noise=0.3):
        wrong = rng.random(len(part)) < share
        stereo = part.stereo.copy()
        stereo[wrong] = rng.uniform([0, 0, 3], [340, 260, 25], (wrong.sum(), 3))
        parts.append(changed(part, stereo))
    return regular(parts)


def broken_numbers() -> list[Cluster]:
    parts = tracklets(clusters=8)
    for value, part in zip((np.nan, np.inf, -3.0, 0.0), parts[2:6], strict=True):
        part.stereo[::3, 2] = value
    parts[6].t[0] = np.nan
    parts[7].t[0] += 100.0
    return regular(parts)


def all_far_away() -> list[Cluster]:
    parts = []
    for part in tracklets(clusters=8):
        stereo = part.stereo.copy()
        stereo[:, 2] = 1e-3
        parts.append(changed(part, stereo))
    return regular(parts)


def on_a_line() -> list[Cluster]:
    rng = np.random.default_rng(0)
    points = np.array([0.0, 0.0, 3.0]) + np.linspace(-0.5, 0.5, 8)[:, None] * [1.0, 0.2, 0.1]
    clusters = []
    for frame in range(8):
        t = (frame + rng.random(8)) * PERIOD
        T = constant_velocity(t)
        local = np.einsum("nji,nj->ni", T[:, :3, :3], points - T[:, :3, 3])
        seen = Measurements(np.arange(8), np.full(8, frame), t, CAMERA.project(local))
        clusters.append(((frame + 1) * PERIOD, seen))
    return clusters


def behind_the_camera() -> list[Cluster]:
    """Landmarks whose measurements agree only with a point behind one of the cameras."""
    parts = tracklets(clusters=8)
    for part in parts[3:]:
        part.stereo[:2] = [[1e5, -1e5, 1e-9], [-1e5, 1e5, 1e5]]
    return regular(parts)


def a_microsecond_apart() -> list[Cluster]:
    parts = []
    for part in tracklets(clusters=6):
        twin = Measurements(part.landmark, part.frame, part.t + 1e-6, part.stereo)
        parts.append(Measurements.concatenate([part, twin]))
    return regular(parts)


def coincident() -> list[Cluster]:
    parts = []
    for frame, part in enumerate(tracklets(clusters=6)):
        t = np.full(len(part), (frame + 0.5) * PERIOD)
        parts.append(Measurements(part.landmark, part.frame, t, part.stereo))
    return regular(parts)


def gap_of_seconds() -> list[Cluster]:
    """The events stop for three seconds; the clusters after it are three seconds later."""
    parts = tracklets(clusters=11)
    clusters = regular(parts[:5])
    for frame, part in enumerate(parts[9:], 9):
        moved = Measurements(part.landmark + 1000, part.frame, part.t + 3, part.stereo)
        clusters.append(((frame + 1) * PERIOD + 3, moved))
    return clusters


def nothing_for_seconds() -> list[Cluster]:
    parts = tracklets(clusters=5)
    empty = [((5 + frame + 1) * PERIOD, NOTHING) for frame in range(20)]
    return regular(parts) + empty


def late_and_early() -> list[Cluster]:
    """Measurements of the first clusters again, long after they have left the window."""
    parts = tracklets(clusters=11)
    parts[10] = Measurements.concatenate([parts[10], parts[0], parts[1]])
    return regular(parts)


def absurd() -> list[Cluster]:
    """Where no camera sees, from the first cluster on, and a pause in between."""
    rng, parts = np.random.default_rng(0), tracklets(clusters=8, noise=0.3)
    for part in parts:
        wrong = rng.random(len(part)) < 0.3
        part.stereo[wrong] = np.abs(rng.uniform(-1e6, 1e6, (wrong.sum(), 3)))
    clusters = regular(parts)
    return [*clusters[:4], (clusters[4][0] + 3, clusters[4][1]), *clusters[5:]]


def same_end_twice() -> list[Cluster]:
    clusters = regular(tracklets(clusters=6))
    return [*clusters[:3], (clusters[2][0], NOTHING), *clusters[3:]]


CASES: list[Callable[[], list[Cluster]]] = [
    broken_numbers,
    all_far_away,
    on_a_line,
    behind_the_camera,
    a_microsecond_apart,
    coincident,
    gap_of_seconds,
    nothing_for_seconds,
    late_and_early,
    absurd,
    same_end_twice,
]


def run(
    clusters: list[Cluster], fit: VelocityFit | None = None, **settings: object
) -> tuple[Trajectory, list]:
    config = EstimatorConfig(**settings)  # type: ignore[arg-type]
    estimator = METHODS[config.method](CAMERA, NoiseConfig(), config)
    for frame, (stop, measurements) in enumerate(clusters):
        estimator.update(frame, stop, measurements, fit)
    trajectory = estimator.trajectory(0)
    assert trajectory is not None
    return trajectory, estimator.repairs


def check(trajectory: Trajectory) -> None:
    assert (np.diff(trajectory.t) > 0).all()
    t = np.linspace(trajectory.start, trajectory.stop, 50)
    assert np.isfinite(trajectory.pose(t)).all()
    assert np.isfinite(trajectory.velocity(t)).all()
    covariance = trajectory.covariance(t)
    assert (np.diagonal(covariance, 0, 1, 2) > 0).all()


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("interval", [0.0, 0.025])
def test_it_goes_on(case: Callable[[], list[Cluster]], method: str, interval: float) -> None:
    trajectory, _ = run(case(), method=method, state_interval=interval)
    check(trajectory)


@pytest.mark.parametrize("loss", ["huber", "cauchy", "gnc"])
@pytest.mark.parametrize("method", METHODS)
def test_robust_losses_survive_half_outliers(method: str, loss: str) -> None:
    fit = VelocityFit(TWIST, 1e-4 * np.eye(6), np.ones(0, bool))
    trajectory, _ = run(outliers(0.5), fit, method=method, loss=loss)
    check(trajectory)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("interval", [0.0, 0.025])
def test_the_gate_keeps_wrong_measurements_out_and_tells_them(method: str, interval: float) -> None:
    """Of landmarks that are known by then; those that are right come in."""
    parts = tracklets(clusters=7, per_cluster=10, noise=0.3)
    known, count = np.unique(np.concatenate([p.landmark for p in parts[:4]]), return_counts=True)
    wrong = [np.isin(part.landmark, known[count >= 2][::2]) for part in parts[4:]]
    for part, mask in zip(parts[4:], wrong, strict=True):
        part.stereo[mask, :2] += 40.0
    values = {tuple(x) for p, m in zip(parts[4:], wrong, strict=True) for x in p.stereo[m].tolist()}
    settings = {"method": method, "state_interval": interval}
    gated, repairs = run(regular(parts), gate=0.9999, **settings)
    told = {repair.measurement for repair in repairs if "gate" in repair.reason}
    assert told == values
    assert np.abs(gated.velocity(gated.t) - TWIST).max() < 0.1


@pytest.mark.parametrize("method", METHODS)
def test_update_returns_the_window_as_it_is_estimated_now(method: str) -> None:
    estimator = METHODS[method](CAMERA, NoiseConfig(), EstimatorConfig(state_interval=0.025))
    assert len(estimator.update(0, PERIOD, NOTHING, None)) == 0
    for frame, part in enumerate(tracklets(clusters=7), 1):
        states = estimator.update(frame, (frame + 1) * PERIOD, part, None)
    trajectory = estimator.trajectory(0)
    assert trajectory is not None and len(states) < len(trajectory)
    assert np.array_equal(states.t, trajectory.t[-len(states) :])
    assert np.allclose(states.T_world_cam, trajectory.T_world_cam[-len(states) :], atol=1e-12)


def test_impossible_measurements_are_told_with_key_time_and_values() -> None:
    for method in METHODS:
        _, repairs = run(broken_numbers(), method=method)
        reasons = [repair.reason for repair in repairs]
        for reason in ("finite", "disparity", "beyond the cluster's end"):
            assert any(reason in told for told in reasons)
        assert all(repair.key.startswith("l") for repair in repairs)
        assert all(len(repair.measurement or ()) == 3 for repair in repairs)


@pytest.mark.parametrize("fault", ["raised", "not finite", "negative"])
def test_covariances_are_the_priors_where_gtsam_has_none(
    monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    """From the first state on, so that they only grow; those of the twist by Q_c dt."""

    def broken(_: object, numbers: list[int]) -> np.ndarray:
        if fault == "raised":
            raise RuntimeError("indeterminate")
        return np.full((len(numbers) - 1, 24, 24), np.nan if fault == "not finite" else -1.0)

    monkeypatch.setattr("gpvo.estimator.smoother.joint_covariances", broken)
    clusters = regular(tracklets(clusters=8))
    trajectory, _ = run(clusters, method="fixed_lag", state_interval=0.025)
    check(trajectory)
    first, last = np.diagonal(trajectory.knot_covariance[[0, -1]], 0, 1, 2)[:, [6, 18]]
    elapsed = trajectory.t[trajectory.knots[-1]] - trajectory.t[0]
    assert last[1] - first[0] == pytest.approx(NoiseConfig().acceleration_psd[0] * elapsed)
