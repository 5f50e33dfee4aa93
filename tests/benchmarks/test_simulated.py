"""The simulated suite: the same on every executor, and comparable with an earlier summary."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from benchmarks import simulated
from benchmarks.fault_cases import unharmed
from benchmarks.simulated_cases import CASES, FLIGHTS, Case, all_cases
from benchmarks.simulated_summary import (
    METRICS,
    CaseResult,
    change_text,
    read_summary,
    write_summary,
)
from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.evaluation.report.run_time import Cost
from gpvo.simulation import SimulationConfig
from gpvo.trajectory import StampedPoses

SMALL = SimulationConfig(
    motion="back_and_forth", duration=0.5, resolution=(120, 90), focal_length=83.0
)
SUITE = (Case("small", SMALL), Case("still", SMALL.model_copy(update={"motion": "still"})))


COST = Cost(0.5, 1000, 1.0, 1.0, 2**20, {"tracking": 0.3})


def run(*options: object) -> tuple[list[CaseResult], str]:
    text = StringIO()
    results = simulated.main(list(map(str, options)), Console(file=text, width=160), SUITE)
    return results, text.getvalue()


def errors(results: list[CaseResult]) -> list[CaseResult]:
    """Without the speed, which is never the same."""
    return [replace(result, real_time=0.0, cost=None) for result in results]


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[CaseResult], Path]:
    """Results and folder of a run with one seed."""
    folder = tmp_path_factory.mktemp("suite")
    config = folder / "config.yaml"
    config.write_text(
        "tracking: {klt: {max_features: 30}}\nclustering: {max_events: 4000}\n"
        "estimator: {method: batch, state_interval: 0.02}\n"
    )
    results, _ = run("--seeds", 1, "--jobs", 1, "--config", config, "--output", folder)
    return results, folder


def test_a_run_leaves_a_summary_a_table_and_a_plot(first) -> None:
    results, folder = first
    small, still = results
    assert (small.case, small.seed, small.failure) == ("small", 0, "")
    assert small.final_percent < 40.0 and 0.5 < small.covered <= 1.0
    assert "no landmark could be tracked" in still.failure and np.isnan(still.rms_m)
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["configuration"]["estimator"]["state_interval"] == 0.02
    assert repr(read_summary(folder / "summary.json")) == repr(results)
    cost = summary["results"][0]["cost"]
    assert cost["stages"]["tracking"] > 0.0 and cost["machine"]["packages"]["gtsam"]
    shorter = summary["simulations"]["small"] | {"duration": 0.4}
    (kept,) = read_summary(folder / "summary.json", summary["simulations"] | {"small": shorter})
    assert kept.case == "still"
    text = (folder / "tables.md").read_text()
    assert "| small |" in text and "| peak memory |" in text
    assert (folder / "simulated.png").read_bytes().startswith(b"\x89PNG")


def test_results_so_far_are_kept_if_the_suite_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ended(case: Case, seed: int, configuration: Configuration) -> CaseResult:
        if seed:
            raise KeyboardInterrupt
        return CaseResult(case.name, seed, failure="nothing moved")

    monkeypatch.setattr(simulated, "run_case", ended)
    with pytest.raises(KeyboardInterrupt):
        run("--cases", "still", "--seeds", 2, "--jobs", 1, "--output", tmp_path)
    (kept,) = read_summary(tmp_path / "summary.json")
    assert (kept.case, kept.seed) == ("still", 0)


def test_a_dask_cluster_gives_the_same_and_comparison_shows_it(first) -> None:
    distributed = pytest.importorskip("distributed")
    results, folder = first
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as cluster:
        again, text = run(
            "--scheduler", cluster.scheduler_address, "--seeds", 1,
            "--config", folder / "config.yaml", "--against", folder / "summary.json",
        )  # fmt: skip
    assert repr(errors(again)) == repr(errors(results))
    assert "Compared with the earlier summary" in text and "+0 %" in text


def test_unreachable_clusters_and_unknown_cases_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="known are small, still"):
        run("--cases", "smal")
    (tmp_path / "summary.json").write_text("[]")
    with pytest.raises(InputError, match="is no summary"):
        run("--against", tmp_path / "summary.json")
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="cannot be reached"):
        run("--scheduler", "nowhere", "--cases", "still")


def test_a_summary_is_read_as_it_was_written(tmp_path: Path) -> None:
    results = [
        CaseResult("a", 1, 2.0, 0.1, 0.3, 1e-3, 1.0, 0.5, COST),
        CaseResult("b", 0, failure="no"),
    ]
    write_summary(tmp_path / "summary.json", results, {})
    assert repr(read_summary(tmp_path / "summary.json")) == repr(results)


def test_a_change_is_a_verdict_where_it_is_large_and_every_seed_agrees() -> None:
    error, speed = METRICS[0], METRICS[-1]
    then = {0: 1.0, 1: 2.0}
    assert change_text({0: 0.5, 1: 1.0}, then, error) == "-50 % better"
    assert change_text({0: 2.0, 1: 4.0}, then, error) == "+100 % worse"
    assert change_text({0: 2.0, 1: 4.0}, then, speed) == "+100 % better"
    assert change_text({0: 0.2, 1: 2.5}, then, error) == "-10 %"
    assert change_text({0: 1.01, 1: 2.02}, then, error) == "+1 %"
    assert change_text({1: 1.0, 2: 9.0}, then, error) == "-50 % better"
    assert change_text({}, then, error) == "lost"
    assert change_text(then, {}, error) == "new"


def test_the_suite_has_what_makes_odometry_hard() -> None:
    assert len(CASES) >= 8 and len({case.name for case in CASES}) == len(CASES)
    motions = {case.config.motion for case in CASES}
    assert motions == {"hand_held", "fast", "rotation", "back_and_forth", "corridor", "driving"}
    assert {case.config.resolution[1] for case in CASES} == {180, 260, 480, 720}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_workers_can_be_sent_each_case(case: Case) -> None:
    sent = pickle.loads(pickle.dumps(case))
    assert sent.name == case.name and sent.config == case.config


@pytest.mark.parametrize("name", ["hot_pixels", "flicker", "half_dead", "5_s_still", "passes_by"])
def test_sensors_that_are_not_as_they_should_be(name: str) -> None:
    """The harm is done, and the stream stays one: in order of time, within the sensor."""
    case = next(case for case in CASES if case.name == name)
    whole, harmed = (
        replace(case, config=SMALL.model_copy(update={"duration": 0.3}), harm=harm).recording(3)
        for harm in (unharmed, case.harm)
    )
    width, height = harmed.rig.resolution
    for events in (harmed.left, harmed.right):
        assert (np.diff(events.t) >= 0).all()
        assert events.x.max() < width and events.y.max() < height
    if name == "half_dead":
        assert 0.4 < len(harmed.right) / len(whole.right) < 0.6
    elif name == "5_s_still":
        assert harmed.duration == pytest.approx(whole.duration + 5.0)
        noise = 0.1 * width * height * 5.0
        assert len(harmed.left) - len(whole.left) == pytest.approx(noise, rel=0.1)
    elif name == "passes_by":
        seen = [set(zip(r.left.x, r.left.y, r.left.t, strict=True)) for r in (whole, harmed)]
        gone, come = seen[0] - seen[1], seen[1] - seen[0]
        assert len(gone) > 100 and len(come) > 100 and len(seen[0] & seen[1]) > 1000
        assert all(0.1 * width < u < 0.45 * width for u, _, _ in gone | come)
    else:
        assert len(harmed.left) > 1.5 * len(whole.left)


def test_real_flights_are_flown(shared_reference: Path) -> None:
    """The simulated camera passes through the real poses, rid of where the room was."""
    flights = [case for case in all_cases(shared_reference) if case.name in FLIGHTS]
    assert len(flights) == 2
    recording = replace(flights[0], config=SMALL).shorter(0.3).recording(seed=5)
    assert recording.duration <= 0.3
    flight, truth = flights[0].flight, recording.ground_truth
    assert isinstance(flight, StampedPoses)
    np.testing.assert_allclose(truth.T_world_cam[::20], flight.T_world_cam[:4], atol=1e-9)
    walls = recording.scene.boxes[0]
    assert (walls[0] < truth.positions).all() and (truth.positions < walls[1]).all()
    assert len(recording.left) > 1000
