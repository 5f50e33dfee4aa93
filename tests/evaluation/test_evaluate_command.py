"""`gpvo eval`: the files that it finds, its output and its report."""

import errno
import json
import re
from io import StringIO

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from factors.lie import se3_exp
from gpvo.commands.cli import app
from gpvo.commands.evaluate import evaluate_command, parse_competitor
from gpvo.errors import InputError, OutputError
from gpvo.evaluation.comparison import compare
from gpvo.evaluation.metrics.gp_interpolation import most_probable_velocities
from gpvo.evaluation.poses.continuous import ContinuousPoses
from gpvo.evaluation.poses.find import find_sources
from gpvo.evaluation.protocol import Contender, Protocol
from gpvo.evaluation.report.run_time import CostMeter, write_cost
from gpvo.trajectory import StampedPoses, Trajectory, write_tum


@pytest.fixture
def sequence(random_walk, tmp_path):
    return written(tmp_path, random_walk)


def written(folder, random_walk):
    """Write a result folder, a competitor and a ground truth."""
    write_tum(folder / "truth.txt", random_walk(1, 300))
    (folder / "results").mkdir()
    write_tum(folder / "results" / "trajectory.tum", random_walk(2, 300))
    write_tum(folder / "esvo.txt", random_walk(3, 70, 30_000_000))
    return folder


def run(*arguments, **options):
    output = StringIO()
    console = Console(file=output, width=100)
    return evaluate_command(*arguments, console=console, **options), output.getvalue()


@pytest.fixture(scope="module")
def reported(random_walk, tmp_path_factory):
    """Report a result, of which the cost is known, against a competitor."""
    folder = written(tmp_path_factory.mktemp("reported"), random_walk)
    cost = CostMeter({"tracking": 0.1}).total(recording_seconds=10.0, events=1000)
    write_cost(folder / "results", cost)
    competitor, report = [f"ESVO={folder / 'esvo.txt'}"], folder / "report"
    comparisons, text = run(
        folder / "results", folder / "truth.txt", against=competitor, output=report
    )
    return report, cost, comparisons, text


def test_a_result_against_a_competitor(reported):
    """As in the paper, both are compared at the competitor's states."""
    report, _, comparisons, text = reported
    ours, esvo = comparisons[0].evaluations
    assert (ours.name, esvo.name) == ("gpvo", "ESVO")
    np.testing.assert_array_equal(ours.estimate.stamps_ns, esvo.estimate.stamps_ns)
    assert len(ours.estimate) == 70
    for word in ("global error", "relative error", "trajectory error", "ESVO", "at the states"):
        assert word in text
    numbers = json.loads((report / "metrics.json").read_text())
    assert [one["name"] for one in numbers[0]["estimates"]] == ["gpvo", "ESVO"]
    assert numbers[0]["estimates"][0] == ours.to_dict()


def test_numbers_are_whole_beside_many_long_names(sequence):
    """They were cut to "0.2…" as soon as a name had more than ten letters."""
    against = [f"odometry of program {k}={sequence / 'esvo.txt'}" for k in range(6)]
    ((comparison,), text) = run(sequence / "results", sequence / "truth.txt", against=against)
    assert "…" not in text
    for table in comparison.tables():
        for _, *cells in table.rows:
            assert all(cell.text in text for cell in cells)


@pytest.mark.parametrize("names", [("ESVO", "ESVO"), ("gpvo",)])
def test_two_estimates_of_one_name_are_refused(sequence, names):
    """Of two competitors one was left out in silence; a plot of paths lost one of both."""
    against = [f"{name}={sequence / 'esvo.txt'}" for name in names]
    with pytest.raises(InputError, match=f"esvo.txt: its name, {names[0]}, is"):
        run(sequence / "results", sequence / "truth.txt", against=against)


def test_the_cost_of_a_result_stands_beside_its_errors(reported):
    report, cost, (comparison,), text = reported
    assert comparison.costs == {"gpvo": cost}
    assert "100.00 x" in text and "events per second" in text and "Cost of gpvo: " in text
    assert "peak memory" in (report / "tables.tex").read_text()
    assert "wall_seconds" not in (report / "metrics.json").read_text()


def test_the_report_is_whole_and_reproducible(sequence):
    for name in ("one", "two"):
        run(sequence / "results", sequence / "truth.txt", output=sequence / name)
    files = sorted(path.relative_to(sequence / "one") for path in (sequence / "one").rglob("*.*"))
    assert {path.name for path in files} == {
        "metrics.json", "tables.md", "tables.tex", "report.html",
        "path.png", "path_3d.png", "error_over_path.png", "error_over_time.png",
    }  # fmt: skip
    for path in files:
        assert (sequence / "one" / path).read_bytes() == (sequence / "two" / path).read_bytes()
    html = (sequence / "one" / "report.html").read_text()
    assert len(re.findall(r'<img [^>]*src="data:image/png;base64,', html)) == 4
    assert not re.findall(r'(?:src|href)="(?!data:)', html)
    assert html.count("<table>") == 3


def test_a_report_where_none_can_be_is_refused_at_once(sequence):
    with pytest.raises(InputError, match=r"truth\.txt: cannot be written to"):
        run(sequence / "results", sequence / "truth.txt", output=sequence / "truth.txt")


def test_a_full_disk_is_one_line(sequence, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("gpvo.evaluation.report.report.write_report", full)
    with pytest.raises(OutputError, match=r"report: cannot be written \(No space left on device"):
        run(sequence / "results", sequence / "truth.txt", output=sequence / "report")


def test_a_fixed_step_overrides_the_states(sequence):
    competitor = [f"ESVO={sequence / 'esvo.txt'}"]
    (comparison,), _ = run(
        sequence / "results", sequence / "truth.txt", competitor, protocol=Protocol(step=0.05)
    )
    for evaluation in comparison.evaluations:
        assert (np.diff(evaluation.estimate.stamps_ns) == 50_000_000).all()


def test_a_step_with_too_many_poses_is_refused(sequence):
    for file in ("truth.txt", "esvo.txt"):
        with pytest.raises(InputError, match=r"truth\.txt: --step 1e-06: compares \d{7} poses"):
            run(sequence / file, sequence / "truth.txt", protocol=Protocol(step=1e-6))


def test_offsets_of_clock_and_body_are_removed_when_asked(random_walk, random_transform):
    truth = random_walk(5, 500)
    T = random_transform(1)
    T[:3, 3] = 0.0
    estimate = truth.seen_from(T)
    late = type(estimate)(estimate.stamps_ns - 30_000_000, estimate.T_world_cam)
    plain = compare("walk", [Contender("late", late, truth)])
    fair = compare(
        "walk", [Contender("late", late, truth)], Protocol(align_body="rotation", align_time=True)
    )
    assert fair.time_offsets["late"] == pytest.approx(0.03, abs=2e-4)
    assert fair.evaluations[0].ate["first"].rotation.rmse < 1e-2
    assert plain.evaluations[0].ate["se3"].rotation.rmse > 0.5
    assert "body offset removed (rotation)" in fair.conditions


def test_another_body_is_pointed_out(random_walk, tmp_path):
    truth = random_walk(5)
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    write_tum(tmp_path / "stamped_groundtruth.txt", truth)
    write_tum(tmp_path / "turned.txt", truth.seen_from(turned))
    _, text = run(tmp_path / "turned.txt", output=tmp_path / "report")
    assert "--align-body" in text
    assert "--align-body" in (tmp_path / "report" / "report.html").read_text()
    _, text = run(tmp_path / "turned.txt", protocol=Protocol(align_body="rotation"))
    assert "--align-body" not in text


def test_ground_truth_is_found_beside_the_estimate(random_walk, tmp_path):
    for folder in ("b_sequence", "a_sequence"):
        (tmp_path / folder).mkdir()
        for name in ("esvo", "es_ptam", "es_ptam_groundtruth", "stamped_groundtruth"):
            write_tum(tmp_path / folder / f"{name}.txt", random_walk())
    (tmp_path / "no_sequence").mkdir()
    sequences = find_sources(tmp_path)
    assert [sequence.name for sequence in sequences] == ["a_sequence", "b_sequence"]
    found = [(one.name, one.ground_truth.name) for one in sequences[0].estimates]
    assert found == [
        ("es_ptam", "es_ptam_groundtruth.txt"),
        ("esvo", "stamped_groundtruth.txt"),
    ]
    (single,) = find_sources(tmp_path / "a_sequence" / "esvo.txt")
    assert single.estimates[0].ground_truth.name == "stamped_groundtruth.txt"


def test_rpg_folder(random_walk, tmp_path):
    write_tum(tmp_path / "stamped_traj_estimate.txt", random_walk(1))
    write_tum(tmp_path / "stamped_groundtruth.txt", random_walk(2))
    (comparison,), _ = run(tmp_path)
    assert len(comparison.evaluations) == 1


def test_missing_inputs_are_named(sequence, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="--ground-truth"):
        find_sources(sequence / "results")
    with pytest.raises(InputError, match="no such file"):
        find_sources(tmp_path / "nowhere")
    with pytest.raises(InputError, match="shorter step"):
        run(sequence / "results", sequence / "truth.txt", protocol=Protocol(step=100.0))
    with pytest.raises(InputError, match="holds no estimate"):
        find_sources(tmp_path / "empty")
    with pytest.raises(InputError, match="no such file"):
        run(sequence / "results", sequence / "nowhere.txt")
    for text in ("ESVO", "=file.txt", "ESVO="):
        with pytest.raises(InputError, match="NAME=FILE"):
            parse_competitor(text)


@pytest.mark.parametrize(
    ("path", "name", "ate"),
    [
        ("mvsec_indoor_flying1", "esvo2", 0.076),
        ("mvsec_indoor_flying3", "esvo2", 0.073),
        ("mvsec_indoor_flying1", "es_ptam", 0.149),
        ("dsec_zurich_city_04_a", "esvo", 3.74),
    ],
)
def test_known_errors_of_other_systems(shared, path, name, ate):
    (comparison,), text = run(shared / "reference" / path / f"{name}.txt")
    found = comparison.evaluations[0].ate["se3"].translation.rmse
    assert found == pytest.approx(ate, abs=6e-3 if ate > 1 else 6e-4)
    assert f"{found:.4f} m" in text


def test_esvo_on_dsec_interpolated_as_published(shared):
    """The ATE is 3.713 m at the ground truth's stamps, 3.74 m with the nearest poses (above)."""
    path = shared / "reference" / "dsec_zurich_city_04_a" / "esvo.txt"
    (comparison,), text = run(path, protocol=Protocol(association="interpolated"))
    found = comparison.evaluations[0].ate["se3"].translation.rmse
    assert found == pytest.approx(3.713, abs=6e-4)
    assert "sparser trajectory's stamps" in " ".join(text.split())


def test_esvo_on_room1_in_one_command(shared):
    """Two runs of ESVO, compared every 0.01 s, have the README's errors."""
    recordings, reference = shared / "recordings", shared / "reference" / "room1_indoor1"
    (comparison,), _ = run(
        reference / "esvo_ros.txt",
        recordings / "room1_indoor1_gt.hdf5",
        against=[f"ESVO (offline)={reference / 'esvo_offline.txt'}"],
        protocol=Protocol(step=0.01),
        calibration=recordings / "camchain-imucam-indoor_flying.yaml",
    )
    errors = [one.global_error.statistics("translation") for one in comparison.evaluations]
    steps = [one.relative_error.statistics("se3") for one in comparison.evaluations]
    aligned = [one.ate["se3"].translation.rmse for one in comparison.evaluations]
    assert [one.final_percent for one in errors] == pytest.approx([9.4, 10.6], abs=0.05)
    assert [one.rms for one in errors] == pytest.approx([0.52, 0.54], abs=0.005)
    assert [one.rms for one in steps] == pytest.approx([1.50e-2, 1.57e-2], abs=5e-5)
    assert aligned == pytest.approx([0.21, 0.22], abs=0.005)


@pytest.fixture
def continuous(tmp_path):
    """Write a result folder with a trajectory and its ground truth, a turn at constant velocity."""
    start_ns, twist = 1_504_645_177_000_000_000, np.array([0.1, -0.4, 0.2, 0.3, 0.1, 0.5])
    t = np.arange(0.0, 3.0, 0.15)
    trajectory = Trajectory(
        start_ns,
        t,
        se3_exp(t[:, None] * twist),
        np.tile(twist, (len(t), 1)),
        np.ones(6),
        np.arange(2),
        np.eye(24)[None],
        np.ones(2),
    )
    (tmp_path / "result").mkdir()
    trajectory.save(tmp_path / "result" / "trajectory.npz")
    trajectory.export_tum(tmp_path / "result" / "trajectory.tum")
    fine = np.arange(0.0, 3.0, 0.001)
    stamps_ns = start_ns + np.round(fine * 1e9).astype(np.int64)
    truth = StampedPoses(stamps_ns, se3_exp(fine[:, None] * twist))
    write_tum(tmp_path / "result" / "ground_truth.tum", truth)
    return tmp_path / "result", truth


def test_a_continuous_result_is_asked_not_interpolated(continuous, random_walk, tmp_path):
    """Between sparse states a straight line deviates from the turn by almost a millimetre."""
    folder, truth = continuous
    (alone,), _ = run(folder)
    assert alone.conditions.startswith("Compared every 0.01 s")
    competitor = truth[50:2500:37]
    write_tum(tmp_path / "esvo.txt", competitor)
    (against,), _ = run(folder, against=[f"ESVO={tmp_path / 'esvo.txt'}"])
    for comparison in (alone, against):
        ours = comparison.evaluations[0]
        assert ours.global_error.norms["se3"].max() < 1e-7
        assert ours.ate["none"].translation.max < 1e-7
    np.testing.assert_array_equal(against.evaluations[0].estimate.stamps_ns, competitor.stamps_ns)
    (plain,), _ = run(folder / "trajectory.tum", protocol=Protocol(step=0.01))
    assert plain.evaluations[0].global_error.norms["translation"].max() > 5e-4


def test_of_two_continuous_results_both_are_asked_at_the_same_times(continuous, tmp_path):
    folder, truth = continuous
    write_tum(tmp_path / "esvo.txt", truth[100:2000:50])
    esvo, other = f"ESVO={tmp_path / 'esvo.txt'}", f"other={folder / 'trajectory.npz'}"
    (three,), _ = run(folder, against=[other, esvo])
    assert {len(one.estimate) for one in three.evaluations} == {38}
    (two,), _ = run(folder, against=[other])
    assert two.conditions.startswith("Compared every 0.01 s")
    (turned,), _ = run(tmp_path / "esvo.txt", folder / "ground_truth.tum", [other])
    assert turned.evaluations[1].global_error.norms["se3"].max() < 1e-7
    assert len(turned.evaluations[1].estimate) == 38


def test_a_continuous_result_on_another_clock(random_walk):
    """The trajectory is evaluated at the stamps of its own clock."""
    truth = random_walk(5, 500)
    t = truth.seconds
    trajectory = Trajectory(
        int(truth.stamps_ns[0]) - 30_000_000, t, truth.T_world_cam,
        most_probable_velocities(truth), np.ones(6), np.arange(2), np.eye(24)[None], np.ones(2),
    )  # fmt: skip
    contender = Contender("late", ContinuousPoses.of(trajectory), truth)
    comparison = compare("walk", [contender], Protocol(align_time=True))
    assert comparison.time_offsets["late"] == pytest.approx(0.03, abs=2e-4)
    assert comparison.evaluations[0].global_error.norms["translation"].max() < 1e-2


@pytest.mark.parametrize(
    ("protocol", "problem"),
    [(Protocol(), "nothing to compare"), (Protocol(align_time=True), "too little in common")],
)
def test_files_that_cannot_be_compared_are_named(sequence, random_walk, protocol, problem):
    later = sequence / "later.txt"
    write_tum(later, random_walk(1, 300).later(10**12))
    files = f"{sequence / 'esvo.txt'} and {later}"
    with pytest.raises(InputError, match=f"^{re.escape(files)}: {problem}"):
        run(sequence / "esvo.txt", later, protocol=protocol)


def test_a_competitor_of_another_time_is_named(sequence, random_walk):
    """The estimate and the ground truth fit each other, and are not what is wrong."""
    write_tum(sequence / "later.txt", random_walk(1, 300).later(10**12))
    with pytest.raises(InputError, match=r"compared at the states of ESVO, \d+.* to \d+.* s: noth"):
        run(sequence / "results", sequence / "truth.txt", [f"ESVO={sequence / 'later.txt'}"])


def test_all_can_be_compared_over_the_time_that_all_cover(sequence, random_walk):
    """A competitor that is lost early is compared with what the others did until then."""
    truth = random_walk(1, 300)
    write_tum(sequence / "early.txt", random_walk(3, 300)[40:150])
    files = sequence / "results", sequence / "truth.txt", [f"early={sequence / 'early.txt'}"]
    (own,), _ = run(*files, protocol=Protocol(step=0.1))
    (common,), printed = run(*files, protocol=Protocol(step=0.1, common_time=True))
    whole, early = own.evaluations
    assert whole.coverage > 2 * early.coverage
    assert "only the time that all estimates cover" in " ".join(printed.split())
    stamps = {tuple(one.estimate.stamps_ns) for one in common.evaluations}
    assert stamps == {tuple(early.estimate.stamps_ns)}
    assert early.estimate.stamps_ns[0] == truth.stamps_ns[40]
    lost = common.evaluations[1]
    assert lost.to_dict() | {"coverage": early.coverage} == early.to_dict()


@pytest.mark.parametrize("common_time", [False, True])
def test_gaps_of_the_truth_outside_the_common_time_are_not_mentioned(random_walk, common_time):
    known = np.r_[0:180, 250:300]
    truth, estimate = random_walk(1, 300)[known], random_walk(2, 300)
    contenders = [Contender("whole", estimate, truth), Contender("early", estimate[:150], truth)]
    comparison = compare("walk", contenders, Protocol(common_time=common_time))
    assert ("the ground truth's gaps" in comparison.conditions) != common_time


def test_estimates_without_a_common_time_are_named(sequence, random_walk):
    write_tum(sequence / "first.txt", random_walk(2, 300)[:100])
    write_tum(sequence / "last.txt", random_walk(2, 300)[200:])
    with pytest.raises(InputError, match=r"no time that all estimates cover: first .*, last "):
        run(
            sequence / "first.txt",
            sequence / "truth.txt",
            [f"last={sequence / 'last.txt'}"],
            protocol=Protocol(step=0.1, common_time=True),
        )


def test_options_are_checked():
    for step in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="--step"):
            Protocol(step=step)
    with pytest.raises(InputError, match="--max-difference"):
        Protocol(max_difference=-0.1)


def test_every_option_reaches_the_comparison(sequence):
    """The command line parses all options; a bad one gives exit status 2."""
    files = [str(sequence / "results"), "--ground-truth", str(sequence / "truth.txt")]
    options = (
        "--step 0.02 --truth-between gp --association interpolated --max-difference 0.01"
        " --align-body rotation"
    )
    good = CliRunner().invoke(app, ["eval", *files, *options.split(), "--aligned-at", "first pose"])
    assert good.exit_code == 0, good.output
    text = " ".join(good.output.split())
    for part in ("every 0.02 s", "by the Gaussian process", "sparser", "removed (rotation)"):
        assert part in text
    assert CliRunner().invoke(app, ["eval", *files, "--association", "guess"]).exit_code == 2
