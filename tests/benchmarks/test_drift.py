"""Drift on long recordings: the motions are what they are called, the numbers what they say."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

from benchmarks.drift import VARIANTS, drift, last_round, main, time_in_view
from benchmarks.drift_cases import (
    CORRIDOR_DURATION,
    CORRIDOR_LENGTH,
    FLIGHT_DURATION,
    RADIUS,
    ROUND,
    ROUNDS,
    hover,
    long_cases,
    loop,
    there_and_back,
)
from benchmarks.drift_summary import DriftResult
from benchmarks.simulated_cases import FLIGHTS, Case
from gpvo.config import Configuration
from gpvo.evaluation import evaluate
from gpvo.simulation import SimulationConfig
from gpvo.simulation.motion import Motion
from gpvo.tracking import Measurements
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import rigid_transforms

SMALL = SimulationConfig(
    seed=1, motion="back_and_forth", duration=1.5, resolution=(120, 90), focal_length=83.0
)
SUITE = (Case("small", SMALL), Case("still", SMALL.model_copy(update={"motion": "still"})))


def poses(positions: np.ndarray, step: float) -> StampedPoses:
    """Level poses at positions (N, 3), `step` seconds apart."""
    stamps_ns = np.rint(1e9 * step * np.arange(len(positions))).astype(np.int64)
    return StampedPoses(stamps_ns, rigid_transforms(np.eye(3), positions))


def test_a_run_leaves_a_row_for_each_variant(tmp_path: Path) -> None:
    text = StringIO()
    options = ["--variants", "default", "without anchors", "--jobs", "1", "--output", str(tmp_path)]
    results = main(options, Console(file=text, width=200), SUITE)
    small, unanchored, still, _ = results
    assert (small.case, unanchored.variant) == ("small", "without anchors")
    assert 0.0 < small.ate < small.rms < 0.05 and 0.0 < small.final_percent < 40.0
    assert 0.02 < unanchored.in_view < small.in_view < SMALL.duration
    assert 0.0 < small.nees < 20.0 and small.rms != unanchored.rms
    assert np.isnan(small.last_round)
    assert "no landmark could be tracked" in still.failure
    rows = json.loads((tmp_path / "drift.json").read_text())["results"]
    assert [row["ate"] for row in rows] == [small.ate, unanchored.ate, None, None]
    table = (tmp_path / "drift.md").read_text()
    assert "### small, one seed" in table
    assert (
        f"| without anchors | {unanchored.final_percent:.2f} | {1e3 * unanchored.rms:.1f} |"
        in table
    )
    assert "| default | – | – |" in table.partition("still")[2]


def test_what_was_run_is_kept_when_it_ends_early(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run_case(case: Case, seed: int, _: list[str]) -> list[DriftResult]:
        if case.name == "still":
            raise KeyboardInterrupt
        return [DriftResult(case.name, seed, "default", ate=0.01)]

    monkeypatch.setattr("benchmarks.drift.run_case", run_case)
    with pytest.raises(KeyboardInterrupt):
        main(["--jobs", "1", "--output", str(tmp_path)], Console(file=StringIO()), SUITE)
    rows = json.loads((tmp_path / "drift.json").read_text())["results"]
    assert [(row["case"], row["ate"]) for row in rows] == [("small", 0.01)]


def test_a_trajectory_that_is_one_percent_long_drifts_one_percent() -> None:
    straight = np.outer(np.arange(201), [0.01, 0.0, 0.0])  # half a metre per second
    evaluation = evaluate(poses(1.01 * straight, 0.02), poses(straight, 0.02), step=0.02)
    assert drift(evaluation, "metres") == pytest.approx((0.01, 0.0), abs=1e-6)
    assert drift(evaluation, "seconds") == pytest.approx((0.005, 0.0), abs=1e-6)


def rounds_of_a_circle(count: int) -> NDArray[np.float64]:
    """Positions of all rounds, `count` in each, and where the last one ends."""
    angle = 2.0 * np.pi * np.arange(ROUNDS * count + 1) / count
    return np.stack([np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=1)


def test_the_last_round_is_compared_with_the_first() -> None:
    rounds, step = 200, ROUND / 200
    circle = rounds_of_a_circle(rounds)
    off = np.outer(0.01 * (-1.0) ** np.arange(len(circle)), [0.0, 0.0, 1.0])
    off[2 * rounds :] *= 3.0
    truth = poses(circle, step)
    evaluation = evaluate(poses(circle + off, step), truth, step=step)
    assert last_round(evaluation) == pytest.approx((3.0, 3.0), rel=1e-3)
    shorter = evaluate(poses(circle + off, step)[: 2 * rounds], truth, step=step)
    assert np.isnan(last_round(shorter)).all()


def test_a_last_round_that_lies_elsewhere_is_farther_off_by_the_first() -> None:
    rounds, step = 200, ROUND / 200
    circle = rounds_of_a_circle(rounds)
    number = np.arange(len(circle))
    moved = circle.copy()
    moved[:, 2] += 0.01 * (number // rounds) + 0.01 * (-1.0) ** number
    evaluation = evaluate(poses(moved, step), poses(circle, step), step=step)
    whole, by_first = last_round(evaluation)
    assert whole == pytest.approx(1.0, rel=1e-2)
    assert by_first == pytest.approx(np.sqrt(5.0), rel=1e-2)  # 2 cm away beside 1 cm of noise


def test_a_landmark_is_in_view_from_its_first_to_its_last_measurement() -> None:
    landmark, t = np.array([3, 7, 3, 5, 7, 3, 5]), np.array([0.1, 0.1, 0.2, 0.2, 0.3, 0.8, 0.9])
    measurements = Measurements(landmark, np.zeros(7, np.int64), t, np.zeros((7, 3)))
    assert time_in_view(measurements) == pytest.approx(0.7)  # of 0.7, 0.2 and 0.7


def test_every_variant_differs() -> None:
    dumped = {Configuration.model_validate(each).model_dump_json() for each in VARIANTS.values()}
    assert len(dumped) == len(VARIANTS)


def test_the_loop_comes_back_and_looks_along_its_tangent() -> None:
    motion, t = Motion.through(loop()), np.linspace(0.0, ROUND, 50)
    first, third = motion.pose(t)[:, :3, 3], motion.pose(t + 2.0 * ROUND)[:, :3, 3]
    np.testing.assert_allclose(third, first, atol=1e-3)
    np.testing.assert_allclose(np.ptp(first[:, :2], axis=0), 2.0 * RADIUS, rtol=0.01)
    ahead = motion.twist(t)[:, 3:] / np.linalg.norm(motion.twist(t)[:, 3:], axis=1)[:, None]
    assert (ahead[:, 2] > 0.9).all()


def test_the_others_hover_and_come_back() -> None:
    np.testing.assert_allclose(hover().positions.std(axis=0), 0.01, rtol=0.3)
    t = CORRIDOR_DURATION * np.array([0.0, 0.5, 1.0])
    way = Motion.through(there_and_back()).pose(t)[:, 0, 3]
    np.testing.assert_allclose(way, [0.0, CORRIDOR_LENGTH, 0.0], atol=1e-3)


def test_the_motions_cover_their_recordings(shared_reference: Path) -> None:
    cases = {case.name: case for case in long_cases(shared_reference)}
    assert set(FLIGHTS) < set(cases) and len(cases) == 6
    assert cases["real_flight3"].config.duration == FLIGHT_DURATION
    for case in cases.values():
        assert case.config.duration >= 14.0
        assert case.flight is None or case.flight.seconds[-1] > case.config.duration
