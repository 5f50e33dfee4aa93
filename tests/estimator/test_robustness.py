"""No input makes an estimator fail: what is impossible is left out, and all is listed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import synthetic
from hypothesis import given, settings
from hypothesis import strategies as st
from runs import METHODS, NOTHING, PERIOD, Cluster, fed, make, regular
from synthetic import CAMERA, TWIST, constant_velocity

from gpvo import FixedLagSmoother
from gpvo.config import NoiseConfig
from gpvo.estimator import Diagnostic
from gpvo.mc_ransac import VelocityFit
from gpvo.tracking import Measurements
from gpvo.trajectory import Trajectory


def tracklets(clusters: int, per_cluster: int = 4, noise: float = 0.0) -> list[Measurements]:
    return synthetic.tracklets(clusters, per_cluster, noise)


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
) -> tuple[Trajectory, list[Diagnostic]]:
    estimator = make(**settings)
    return fed(estimator, clusters, fit), estimator.diagnostics


def check(trajectory: Trajectory) -> None:
    assert (np.diff(trajectory.t) > 0).all()
    t = np.linspace(trajectory.start, trajectory.stop, 50)
    assert np.isfinite(trajectory.pose(t)).all()
    assert np.isfinite(trajectory.velocity(t)).all()
    covariance = trajectory.covariance(t)
    assert (np.diagonal(covariance, 0, 1, 2) > 0).all()


INTERVALS = (0.0, 0.025)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(
    "method, interval", [("fixed_lag", 0.0), ("fixed_lag", 0.025), ("batch", 0.025)]
)
def test_it_goes_on(case: Callable[[], list[Cluster]], method: str, interval: float) -> None:
    clusters = case()
    trajectory, diagnostics = run(clusters, method=method, state_interval=interval)
    check(trajectory)
    ends = [end_time for end_time, _ in clusters]
    if method == "fixed_lag":
        assert trajectory.stop == pytest.approx(max(ends))
    for found in diagnostics:
        assert set(found.to_dict()) == {"key", "t", "measurement", "reason"}
        assert found.key[0] in "lxv"
        assert "left out" in found.reason or "again" in found.reason


@pytest.mark.parametrize("case", [broken_numbers, late_and_early, behind_the_camera])
@pytest.mark.parametrize("method", METHODS)
def test_it_follows_the_motion_all_the_same(case: Callable[[], list[Cluster]], method: str) -> None:
    """With a robust loss and a gate, in the clusters before the faults and while they come."""
    trajectory, _ = run(case(), method=method, loss="cauchy", gate=0.9999)
    check(trajectory)
    t = np.linspace(trajectory.start, trajectory.start + 4 * PERIOD, 20)
    assert np.abs(trajectory.velocity(t) - TWIST).max() < 0.5


@pytest.mark.parametrize("case", [on_a_line, coincident, same_end_twice, a_microsecond_apart])
@pytest.mark.parametrize("interval", INTERVALS)
def test_what_is_degenerate_is_no_fault(case: Callable[[], list[Cluster]], interval: float) -> None:
    """It is solved as it is: nothing is left out, and the motion is found."""
    trajectory, diagnostics = run(case(), state_interval=interval)
    assert not diagnostics
    assert np.abs(trajectory.velocity(trajectory.t) - TWIST).max() < 0.2


def faulty(rng: np.random.Generator) -> list[Cluster]:
    """Numbers that are none, wild ones, single and late and repeated measurements, gaps."""
    clusters = list[Cluster]()
    for end_time, part in regular(tracklets(clusters=7, noise=0.3)):
        stereo, t, landmark = part.stereo.copy(), part.t.copy(), part.landmark.copy()
        for _ in range(rng.integers(0, 4)):
            n, fault = rng.integers(len(part)), rng.integers(7)
            if fault == 0:
                stereo[n, rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf])
            elif fault == 1:
                stereo[n] = rng.normal(size=3) * 10.0 ** rng.uniform(-9, 9)
            elif fault == 2:
                t[n] += rng.choice([-1.0, -0.2, -0.04, 0.04, 10.0, np.nan])
            elif fault == 3:
                t[:] = t[n]
            elif fault == 4:
                landmark[n] = rng.choice([0, 1, 2**40, landmark[0]])
            elif fault == 5:
                stereo[:, 2] = 10.0 ** rng.uniform(-6, 3)
            else:
                end_time += rng.choice([-0.2, 0.0, 0.02])
        part = Measurements(landmark, part.frame, t, stereo)
        clusters.append((end_time, part if rng.random() < 0.9 else NOTHING))
    return clusters


@settings(deadline=None, max_examples=25, derandomize=True)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(METHODS),
    st.sampled_from([0.0, 0.025, 0.1]),
    st.sampled_from(["none", "huber", "cauchy", "geman_mcclure"]),
    st.sampled_from([0.0, 0.999]),
)
def test_any_mixture_of_faults_is_survived(
    seed: int, method: str, interval: float, loss: str, gate: float
) -> None:
    rng = np.random.default_rng(seed)
    fit = VelocityFit(rng.normal(size=6), 1e-4 * np.eye(6), np.ones(0, bool))
    estimator = make(
        method=method,
        state_interval=interval,
        loss=loss,
        gate=gate,
        window=int(rng.integers(2, 6)),
        lag=rng.choice([None, 0.001, 0.12]),
    )
    for number, (end_time, part) in enumerate(faulty(rng)):
        estimator.update(end_time, part, fit if number % 3 == 0 else None)
        estimator.final_states()
    trajectory = estimator.trajectory()
    if trajectory is not None and len(trajectory) > 1:
        check(trajectory)


@pytest.mark.parametrize("loss", ["huber", "cauchy", "geman_mcclure"])
@pytest.mark.parametrize("method", METHODS)
def test_robust_losses_survive_half_outliers(method: str, loss: str) -> None:
    fit = VelocityFit(TWIST, 1e-4 * np.eye(6), np.ones(0, bool))
    trajectory, _ = run(outliers(0.5), fit, method=method, loss=loss)
    check(trajectory)


@pytest.mark.parametrize(
    "share, settings",
    [
        (0.4, {"loss": "cauchy"}),
        (0.4, {"loss": "cauchy", "gate": 0.999}),
        (0.2, {"loss": "geman_mcclure"}),
        (0.2, {"loss": "cauchy", "state_interval": 0.025}),
    ],
)
def test_outliers_hardly_matter(share: float, settings: dict[str, object]) -> None:
    """The naive run need not converge, and where it ends differs between processors."""
    fit = VelocityFit(TWIST, 1e-2 * np.eye(6), np.ones(0, bool))
    trajectory, diagnostics = run(outliers(share), fit, **settings)
    naive, _ = run(outliers(share), fit)
    errors = [x.velocity(x.t) - TWIST for x in (trajectory, naive)]
    rms, naive_rms = (np.sqrt(np.mean(error**2)) for error in errors)
    assert np.abs(errors[0]).max() < 0.1
    assert 3 * rms < naive_rms
    assert ("gate" in settings) == any("gate" in found.reason for found in diagnostics)


@pytest.mark.parametrize("method", METHODS)
def test_impossible_measurements_are_listed_with_key_time_and_values(method: str) -> None:
    _, diagnostics = run(broken_numbers(), method=method)
    reasons = [found.reason for found in diagnostics]
    for reason in ("finite", "disparity", "beyond the cluster's end"):
        assert any(reason in text for text in reasons)
    assert all(found.key.startswith("l") for found in diagnostics)
    assert all(len(found.measurement or ()) == 3 for found in diagnostics)


@pytest.mark.parametrize("method", METHODS)
def test_measurements_before_the_window_are_listed(method: str) -> None:
    _, diagnostics = run(late_and_early(), method=method)
    late = [found for found in diagnostics if "before the window" in found.reason]
    assert {found.t for found in late} >= set(tracklets(clusters=11)[0].t.tolist())


@pytest.mark.parametrize("fault", ["raised", "not finite", "negative"])
@pytest.mark.parametrize("interval", INTERVALS)
def test_covariances_are_the_priors_where_gtsam_has_none(
    monkeypatch: pytest.MonkeyPatch, fault: str, interval: float
) -> None:
    """From the first state on, so that they only grow; those of the twist by Q_c dt."""

    def broken(_: object, numbers: list[int]) -> np.ndarray:
        if fault == "raised":
            raise RuntimeError("indeterminate")
        size = 12 * len(numbers)
        return np.full((size, size), np.nan) if fault == "not finite" else -np.eye(size)

    monkeypatch.setattr("gpvo.estimator.isam2.joint_covariance", broken)
    estimator = make(state_interval=interval)
    assert isinstance(estimator, FixedLagSmoother)
    trajectory = fed(estimator, regular(tracklets(clusters=8)))
    check(trajectory)
    first, last = np.diagonal(trajectory.knot_covariance[[0, -1]], 0, 1, 2)[:, [6, 18]]
    elapsed = trajectory.t[trajectory.knots[-1]] - trajectory.t[0]
    expected = NoiseConfig().acceleration_psd[0] * elapsed
    assert 0 < last[1] <= first[0] + 1.01 * expected
    if fault == "negative" or interval > 0:
        assert last[1] - first[0] == pytest.approx(expected)


@pytest.mark.parametrize("loss", ["cauchy", "geman_mcclure"])
@pytest.mark.parametrize(
    "value",
    [(1e4, 1e4, 1e4), (1e6, 1e6, 1e6), (-1e7, 1e7, 10.0), (1e7, 130.0, 1e-6), (200.0, 130.0, 1e7)],
)
def test_one_absurd_measurement_hardly_matters_to_a_robust_loss(
    loss: str, value: tuple[float, float, float]
) -> None:
    clusters = regular(tracklets(clusters=7, noise=0.3))
    clusters[3][1].stereo[0] = value
    trajectory, _ = run(clusters, loss=loss)
    assert np.abs(trajectory.velocity(trajectory.t) - TWIST).max() < 0.1


@pytest.mark.parametrize("end_time", [np.nan, np.inf, None, "0.1"])
def test_an_end_that_is_no_time_is_refused_by_name(end_time: Any) -> None:
    with pytest.raises(ValueError, match="end_time must be"):
        FixedLagSmoother(CAMERA).update(end_time, NOTHING)


def test_lists_are_no_columns() -> None:
    with pytest.raises(ValueError, match=r"measurements\.t must be an array, not list"):
        FixedLagSmoother(CAMERA).update(0.1, replace(NOTHING, t=[]))  # type: ignore[arg-type]
