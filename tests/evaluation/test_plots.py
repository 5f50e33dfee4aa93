"""Contents of the figures, and equal files of equal figures."""

import numpy as np
import pytest

from gpvo.evaluation import evaluate
from gpvo.evaluation.report.figures import COLOURS, line_styles, png, save_figure
from gpvo.evaluation.report.plots import error_figure, path_figure, path_figure_3d, series_figure
from gpvo.evaluation.report.weak_stretches import ShadedStretch


@pytest.fixture(scope="module")
def evaluations(random_walk):
    truth = random_walk(1)
    return [evaluate(random_walk(seed), truth, name=f"estimate {seed}") for seed in (2, 3)]


def test_errors_are_drawn_over_path_and_time(evaluations):
    start = int(evaluations[0].estimate.stamps_ns[0])
    stretch = ShadedStretch(start + 500_000_000, start + 700_000_000, "few tracklets")
    for over, reach in (("path", evaluations[0].path_length), ("time", 1.98)):
        axes = error_figure(evaluations, over, [stretch]).axes
        x, y = axes[0].lines[0].get_data()
        assert x[-1] == pytest.approx(reach)
        np.testing.assert_array_equal(y, evaluations[0].global_error.norms["translation"])
        assert axes[2].get_yscale() == "log"
        assert len(axes[0].patches) == 1


def test_errors_of_a_run_are_drawn_over_the_time_of_its_recording(evaluations):
    first = int(evaluations[0].estimate.stamps_ns[0])
    stretch = ShadedStretch(first + 500_000_000, first + 700_000_000, "dead reckoning")
    for start_ns, shift, words in ((None, 0.0, "since"), (first - 1_300_000_000, 1.3, "time [s]")):
        axes = error_figure(evaluations, stretches=[stretch], start_ns=start_ns).axes
        for one in axes[0].lines:
            assert one.get_xdata()[0] == pytest.approx(shift)
        assert axes[0].patches[0].get_x() == pytest.approx(0.5 + shift)
        assert words in axes[2].get_xlabel()


def test_legends_fit_into_their_figure(evaluations):
    truth = evaluations[0].ground_truth
    for name in ("short", "the estimate of another program"):
        estimates = {f"{name} {number}": truth for number in range(4)}
        figure = path_figure_3d(estimates, truth)
        figure.draw_without_rendering()
        (legend,) = figure.legends
        extent = legend.get_window_extent()
        assert extent.x0 >= 0 and extent.x1 <= figure.bbox.width
        assert len(legend.texts) == 5


def test_curves_are_told_apart_where_the_palette_repeats():
    styles = line_styles(4 * len(COLOURS))
    assert len({tuple(style.values()) for style in styles}) == len(styles)


def test_bands_are_three_standard_deviations(evaluations):
    first = evaluations[0]
    deviations = np.tile([0.01, 0.2], (len(first.estimate), 1))
    translation, rotation, _ = error_figure([first], deviations=deviations).axes
    for axes, height in ((translation, 0.6), (rotation, np.degrees(0.03))):
        (band,) = axes.collections
        assert band.get_paths()[0].get_extents().ymax == pytest.approx(height)


def test_stretches_are_shaded_in_curves():
    shaded = {"dead reckoning": [(0.2, 0.4), (0.6, 0.9)]}
    (axes,) = series_figure([0.0, 1.0], {"inliers": [3, 4]}, "inliers", shaded=shaded).axes
    assert [patch.get_x() for patch in axes.patches] == pytest.approx([0.2, 0.6])


@pytest.mark.parametrize("kind", ["pdf", "svg"])
def test_equal_figures_are_equal_files_in_every_format(tmp_path, kind):
    for name in ("first", "second"):
        figure = series_figure([0.0, 1.0], {"inliers": [3, 4]}, "inliers")
        save_figure(figure, tmp_path / f"{name}.{kind}")
    first, second = ((tmp_path / f"{name}.{kind}").read_bytes() for name in ("first", "second"))
    assert first == second and (b"%PDF" in first or b"<svg" in first)


def test_paths_start_where_the_ground_truth_starts(evaluations):
    estimates = {one.name: one.estimate for one in evaluations}
    truth = evaluations[0].ground_truth
    above, side = path_figure(estimates, truth).axes
    for axes in (above, side):
        assert axes.get_aspect() == 1.0
        for line in axes.lines:
            np.testing.assert_allclose([line.get_xdata()[0], line.get_ydata()[0]], 0.0, atol=1e-9)
    body = np.linalg.inv(truth.T_world_cam[0]) @ truth.T_world_cam[-1]
    assert above.lines[0].get_xdata()[-1] == pytest.approx(body[0, 3])
    assert side.lines[0].get_ydata()[-1] == pytest.approx(-body[1, 3])


def test_a_path_needs_no_ground_truth(random_walk):
    figure = path_figure({"gpvo": random_walk(1)}, None)
    assert len(figure.axes[0].lines) == 2  # the path and its start


def test_equal_figures_are_equal_files(evaluations, tmp_path):
    estimates = {one.name: one.estimate for one in evaluations}
    draw = [
        lambda: path_figure_3d(estimates, evaluations[0].ground_truth),
        lambda: series_figure([0.0, 1.0], {"tracklets": [3, 4]}, "tracklets"),
    ]
    for make in draw:
        save_figure(make(), tmp_path / "figure.png")
        data = (tmp_path / "figure.png").read_bytes()
        assert data == png(make())
        assert data.startswith(b"\x89PNG")
        assert b"matplotlib" not in data.lower()
