"""The whole evaluation: known reference numbers, sampling, tables and JSON."""

import json
from dataclasses import asdict
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from gpvo.errors import InputError
from gpvo.evaluation import (
    absolute_trajectory_error,
    common_stamps,
    evaluate,
    find_alignment,
    global_error,
    relative_error,
    relative_pose_error,
)
from gpvo.evaluation.metrics.association import associate
from gpvo.evaluation.metrics.frame_and_clock_offsets import find_body_offset, find_time_offset
from gpvo.evaluation.metrics.paper_errors import COMPONENTS, PaperStatistics
from gpvo.evaluation.protocol import Contender, Protocol
from gpvo.evaluation.report.paper_tables import ErrorRow, evaluation_tables, global_error_table
from gpvo.evaluation.report.table import Cell, ResultTable, to_html, to_latex, to_markdown, to_rich
from gpvo.trajectory import StampedPoses, read_tum


@pytest.mark.parametrize(
    ("name", "final_percent", "rms", "relative_rms", "ate"),
    [("esvo_ros", 9.4, 0.52, 1.50e-2, 0.21), ("esvo_offline", 10.6, 0.54, 1.57e-2, 0.22)],
)
def test_esvo_on_room1(shared, room1_truth, name, final_percent, rms, relative_rms, ate):
    """ESVO's known errors on this recording are reproduced to their last digit."""
    estimate = read_tum(shared / "reference" / "room1_indoor1" / f"{name}.txt")
    evaluation = evaluate(estimate, room1_truth, step=0.01)
    translation = evaluation.global_error.statistics("translation")
    assert translation.final_percent == pytest.approx(final_percent, abs=0.05)
    assert translation.rms == pytest.approx(rms, abs=0.005)
    relative = evaluation.relative_error.statistics("se3")
    assert relative.rms == pytest.approx(relative_rms, abs=0.5e-4)
    assert evaluation.ate["se3"].translation.rmse == pytest.approx(ate, abs=0.005)
    assert evaluation.coverage == pytest.approx(0.98, abs=0.005)


@pytest.mark.parametrize(
    ("argument", "ask"),
    [
        ("method", lambda poses: find_alignment(poses, poses, "Sim3")),
        ("unit", lambda poses: relative_pose_error(poses, poses, 1.0, "s")),
        ("aligned_at", lambda poses: evaluate(poses, poses, aligned_at="first")),
        ("truth_between", lambda poses: evaluate(poses, poses, truth_between="GP")),
    ],
)
def test_a_name_that_does_not_exist_is_told_with_the_choices(random_walk, argument, ask):
    with pytest.raises(InputError, match=rf"{argument} .+: is unknown; choose one of \w+"):
        ask(random_walk())


@pytest.mark.parametrize("step", [0.0, -0.01, 1e-12, np.nan, np.inf, 1e300])
def test_a_step_that_is_none_is_refused(random_walk, step):
    with pytest.raises(InputError, match=r"step .*: must be seconds"):
        evaluate(random_walk(), random_walk(), step=step)


@pytest.mark.parametrize("compare", [evaluate, associate, find_time_offset])
@pytest.mark.parametrize("kept", [(0, 9), (9, 0), (0, 0)])
def test_no_poses_are_told(random_walk, compare, kept):
    estimate, truth = (random_walk()[:count] for count in kept)
    with pytest.raises(InputError, match="no time"):
        compare(estimate, truth)


@pytest.mark.parametrize(
    "compare",
    [
        absolute_trajectory_error,
        relative_pose_error,
        global_error,
        relative_error,
        find_alignment,
        find_body_offset,
    ],
)
@pytest.mark.parametrize("kept", [(0, 0), (1, 9), (8, 9)])
def test_poses_that_are_not_associated_are_refused(random_walk, compare, kept):
    estimate, truth = (random_walk()[:count] for count in kept)
    with pytest.raises(InputError, match=rf"{kept[0]} and {kept[1]} .*cannot be compared"):
        compare(estimate, truth)


@pytest.mark.parametrize("most", [-1.0, 0.0, np.nan, np.inf])
def test_a_reach_of_the_clocks_that_is_none_is_refused(random_walk, most):
    with pytest.raises(InputError, match="max_offset"):
        find_time_offset(random_walk(), random_walk(), most)


def test_sampling_every_step_of_the_common_time(random_walk):
    truth = random_walk(1, 300)
    estimate = random_walk(2, 200)[50:]
    stamps = common_stamps(estimate, truth, 0.01)
    assert stamps[0] == estimate.stamps_ns[0]
    assert (np.diff(stamps) == 10_000_000).all()
    assert estimate.stamps_ns[-1] - 10_000_000 <= stamps[-1] < estimate.stamps_ns[-1]


def test_given_stamps_outside_the_common_time_are_left_out(random_walk):
    truth, estimate = random_walk(1, 300), random_walk(2, 200)
    evaluation = evaluate(estimate, truth, stamps_ns=truth.stamps_ns)
    np.testing.assert_array_equal(evaluation.estimate.stamps_ns, estimate.stamps_ns)
    assert len(evaluation.relative_error.twists) == len(estimate) - 1
    assert evaluation.coverage == pytest.approx(1.99 / 2.99)


def circle(t: np.ndarray) -> StampedPoses:
    """Return poses on a circle of 1 m, once around in 6.3 s."""
    T = np.tile(np.eye(4), (len(t), 1, 1))
    T[:, 0, 3], T[:, 1, 3] = np.cos(t), np.sin(t)
    return StampedPoses(np.rint(t * 1e9).astype(np.int64), T)


def test_nothing_is_compared_where_poses_are_unknown():
    """A motion capture that loses the body for 3 s, and an odometry that begins anew."""
    t = np.arange(0.0, 10.0, 0.01)
    whole, broken = circle(t), circle(t[(t < 4.0) | (t > 7.0)])
    assert evaluate(whole, broken, stamps_ns=whole.stamps_ns).global_error.norms[
        "translation"
    ].max() == pytest.approx(0.0, abs=1e-3)
    lost = evaluate(broken, whole, step=0.05)
    assert lost.global_error.norms["translation"].max() == pytest.approx(0.0, abs=1e-3)
    assert lost.coverage == pytest.approx(0.7, abs=0.02)
    assert evaluate(whole, broken).coverage == pytest.approx(1.0, abs=0.02)
    text = Protocol().describe([Contender("whole", whole, broken)])
    assert "nothing within the ground truth's gaps, 3.02 s in all" in text


def test_the_first_poses_are_aligned(random_walk):
    evaluation = evaluate(random_walk(1), random_walk(2))
    first, truth = evaluation.estimate.T_world_cam[0], evaluation.ground_truth.T_world_cam[0]
    np.testing.assert_allclose(first, truth, atol=1e-12)
    offsets = evaluation.estimate.positions - evaluation.ground_truth.positions
    rms = np.sqrt(np.mean(np.sum(offsets**2, axis=1)))
    assert evaluation.ate["first"].translation.rmse == pytest.approx(rms)


def test_different_clocks_are_named(random_walk):
    poses = random_walk()
    late = StampedPoses(poses.stamps_ns + 10**12, poses.T_world_cam)
    with pytest.raises(InputError, match="same clock"):
        evaluate(poses, late)


def test_a_platform_at_rest_has_no_percentages():
    stamps = np.arange(100, dtype=np.int64) * 10_000_000
    still = StampedPoses(stamps, np.tile(np.eye(4), (100, 1, 1)))
    numbers = json.loads(evaluate(still, still).to_json())
    assert numbers["global_error"]["translation"]["final_percent"] is None
    assert numbers["rpe"]["1 m"]["translation"]["rmse"] is None
    assert numbers["global_error"]["translation"]["rms"] == 0.0


def test_json_holds_what_the_evaluation_holds(random_walk):
    evaluation = evaluate(random_walk(1), random_walk(2), name="ours")
    numbers = json.loads(evaluation.to_json())
    assert numbers["name"] == "ours"
    for part in COMPONENTS:
        expected = asdict(evaluation.relative_error.statistics(part))
        assert numbers["relative_error"][part] == pytest.approx(expected)
    assert evaluation.to_json() == evaluate(random_walk(1), random_walk(2), name="ours").to_json()


def test_an_evaluation_prints_in_eighty_columns(random_walk):
    output = StringIO()
    evaluation = evaluate(random_walk(1), random_walk(2), name="my [one]")
    Console(width=80, file=output).print(*map(to_rich, evaluation_tables(evaluation)))
    text = output.getvalue()
    assert "my [one]" in text
    assert "…" not in text
    for word in ("tran. (m)", "rota. (rad)", "final %", "ATE, SE(3) aligned"):
        assert word in text


@pytest.mark.parametrize("lateral", [0.002, 1.0])
def test_how_well_an_aligned_rotation_is_known_is_said_of_a_straight_path(lateral):
    """Errors of 5 mm turn the alignment of a path that is 2 mm wide by 70 degrees."""
    rng, t = np.random.default_rng(0), np.arange(200)
    positions = np.column_stack([0.01 * t, lateral * np.sin(t / 20), lateral * np.cos(t / 20)])
    T = np.tile(np.eye(4), (200, 1, 1))
    T[:, :3, 3] = positions
    truth = StampedPoses(10_000_000 * t, T.copy())
    T[:, :3, 3] += rng.normal(0, 0.003, (200, 3))
    evaluation = evaluate(StampedPoses(10_000_000 * t, T), truth)
    assert evaluation.width == pytest.approx(lateral, rel=0.2)
    rows = [[cell.text for cell in row] for row in evaluation_tables(evaluation)[2].rows]
    doubts = [float(text[:-1]) for label, text in rows if label == "aligned rotation is known to"]
    assert len(doubts) == (lateral < 0.01) == (not evaluation.aligned_rotation_is_known)
    width, error = evaluation.width, evaluation.ate["se3"].translation.rmse
    assert doubts == pytest.approx([np.degrees(np.arctan(error / width))] * len(doubts), abs=0.01)


def test_the_gp_follows_a_sparse_ground_truth_better_than_lines(random_walk):
    """The walk is a sample of the process; an exact estimate leaves the error of interpolation."""
    dense = random_walk(1, 400)
    errors = {
        between: evaluate(dense, dense[::20], truth_between=between).global_error
        for between in ("linear", "gp")
    }
    rms = {between: error.statistics("se3").rms for between, error in errors.items()}
    assert rms["gp"] < 0.8 * rms["linear"]


def row(name: str, size: float) -> ErrorRow:
    statistics = PaperStatistics(size, 10 * size, 5 * size, 0.5 * size, float("nan"))
    errors = dict.fromkeys(COMPONENTS, statistics)
    return ErrorRow(name, errors, errors)


def test_the_best_of_several_is_bold():
    table = global_error_table([row("one", 0.2), row("two", 0.1)])
    assert [cell.best for cell in table.rows[0][2:]] == [False] * 5
    assert [cell.best for cell in table.rows[3][2:]] == [True] * 4 + [False]
    assert table.rows[0][6].text == "–"
    assert not any(
        cell.best for cells in global_error_table([row("one", 0.2)]).rows for cell in cells
    )


def test_estimates_of_the_same_name_keep_their_rows():
    table = global_error_table([row("same", 0.2), row("same", 0.1)])
    assert (table.rows[0][2].text, table.rows[3][2].text) == ("0.200", "0.100")


STRANGE = ResultTable("50 % & more", ("a_b", "c|d"), ((Cell("<x>", True), Cell("1.25e-3", True)),))


def test_every_format_escapes_its_special_characters():
    latex = to_latex(STRANGE)
    assert r"50 \% \& more" in latex and r"a\_b" in latex
    assert r"$\boldsymbol{1.25 \cdot 10^{-3}}$" in latex
    html = to_html(STRANGE)
    assert "<td><b>&lt;x&gt;</b></td>" in html and "50 % &amp; more" in html
    assert r"**<x>**" in to_markdown(STRANGE)
    assert to_rich(STRANGE).row_count == 1


def test_markdown_tables_are_rectangular(random_walk):
    rows = [ErrorRow.of(evaluate(random_walk(1), random_walk(2)))]
    lines = to_markdown(global_error_table(rows)).splitlines()[2:]
    assert len({line.count("|") for line in lines}) == 1
