"""NEES of whole runs: what is simulated, and what the table says of it."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from benchmarks.honest_runs import PHASES, SHARES, SLOWED, HonestRun, main, random_motion, summary
from gpvo.evaluation.metrics.nees import mean_nees_interval


def test_a_run_leaves_its_numbers(tmp_path: Path) -> None:
    text, output = StringIO(), tmp_path / "runs.json"
    options = ["--motions", "fast", "--seeds", "1", "--first-seed", "3", "--duration", "0.3"]
    (found,) = main([*options, "--jobs", "1", "--output", str(output)], Console(file=text))
    assert (found.motion, found.seed, found.failure) == ("fast", 3, "")
    numbers = np.array([found.pose, found.velocity])
    assert numbers.shape == (2, len(SHARES)) and (numbers > 0).all() and (numbers < 30).all()
    (written,) = json.loads(output.read_text())
    assert written["pose"] == list(found.pose) and "fast" in text.getvalue()


def test_slow_motion_is_the_same_way_in_more_time() -> None:
    slow, way = random_motion("hand_held", 5, 3.0, SLOWED), random_motion("hand_held", 5, 1.0)
    t = np.linspace(0.0, 3.0, 20)
    np.testing.assert_allclose(slow.pose(t), way.pose(t / SLOWED), atol=2e-3)
    speed, usual = (np.linalg.norm(one, axis=1) for one in (slow.twist(t), way.twist(t / SLOWED)))
    np.testing.assert_allclose(SLOWED * speed, usual, rtol=0.1, atol=0.05)


def test_runs_begin_anywhere_between_waypoints() -> None:
    begins = np.array([random_motion("fast", seed, 1.0).offset for seed in range(50)])
    assert begins.min() >= 0.0 and begins.max() <= PHASES
    counts, _ = np.histogram(begins, 4, (0.0, PHASES))
    assert counts.min() >= 5
    again = random_motion("fast", 7, 1.0)
    np.testing.assert_array_equal(again.pose(0.3), random_motion("fast", 7, 1.0).pose(0.3))


def test_consistent_runs_are_inside_the_interval_and_others_are_not() -> None:
    rng = np.random.default_rng(5)
    runs = []
    for motion, worse in (("good", 1.0), ("bad", 2.0)):
        for seed in range(50):
            pose, velocity = (worse * rng.chisquare(6, (2, len(SHARES))) / 6).tolist()
            runs.append(HonestRun(motion, seed, tuple(pose), tuple(velocity)))
    table = summary([*runs, HonestRun("good", 50, failure="lost")])
    low, high = mean_nees_interval(51) / 6
    assert f"{low:.2f} to {high:.2f}" in table.title
    for row in table.rows:
        name, _, count, mean, median, above, *_ = (cell.text for cell in row)
        assert count == "50" and (low < float(mean) < high) == (name == "good")
        assert 0.5 * float(mean) < float(median) < 1.2 * float(mean)
        assert float(above) < 0.15 if name == "good" else float(above) > 0.2


def test_a_motion_that_is_not_known_is_refused() -> None:
    with pytest.raises(SystemExit):
        main(["--motions", "sideways"], Console(file=StringIO()))
