"""The same numbers as evo, on every reference pair and on random trajectories."""

import copy

import numpy as np
import pytest

pytest.importorskip("evo")
from evo.core import metrics, sync
from evo.core.lie_algebra import so3_from_se3, so3_log_angle
from evo.core.trajectory import PoseTrajectory3D
from evo.tools import file_interface

from gpvo.evaluation import absolute_trajectory_error, find_alignment, relative_pose_error
from gpvo.evaluation.metrics.association import associate, resample
from gpvo.trajectory import StampedPoses, read_tum

PAIRS = [
    ("mvsec_indoor_flying1", "esvo2.txt", "stamped_groundtruth.txt", 0.02),
    ("mvsec_indoor_flying1", "es_ptam.txt", "es_ptam_groundtruth.txt", 0.02),
    ("mvsec_indoor_flying3", "esvo2.txt", "stamped_groundtruth.txt", 0.02),
    ("dsec_zurich_city_04_a", "esvo.txt", "stamped_groundtruth.txt", 0.06),
    ("dsec_zurich_city_04_a", "esvio_aa.txt", "stamped_groundtruth.txt", 0.06),
    ("room1_indoor1", "esvo_ros.txt", None, 0.02),
    ("room1_indoor1", "esvo_offline.txt", None, 0.02),
]
TRANSLATION = metrics.PoseRelation.translation_part
ROTATION = metrics.PoseRelation.rotation_angle_rad
UNITS = {"frames": metrics.Unit.frames, "metres": metrics.Unit.meters}


def to_evo(poses: StampedPoses) -> PoseTrajectory3D:
    return PoseTrajectory3D(poses_se3=list(poses.T_world_cam), timestamps=poses.stamps_ns * 1e-9)


def thinned(poses: StampedPoses) -> StampedPoses:
    """Return some 400 of the poses; evo is slow."""
    return poses[:: max(len(poses) // 400, 1)]


@pytest.fixture(params=PAIRS, ids=lambda pair: "/".join(pair[:2]), scope="module")
def pair(request, shared, room1_truth):
    """Return the associated poses, ours and evo's."""
    sequence, estimate_name, truth_name, tolerance = request.param
    folder = shared / "reference" / sequence
    estimate = thinned(read_tum(folder / estimate_name))
    truth = room1_truth if truth_name is None else read_tum(folder / truth_name)
    evo_truth, evo_estimate = sync.associate_trajectories(
        to_evo(truth), to_evo(estimate), max_diff=tolerance
    )
    return associate(estimate, truth, tolerance), (evo_estimate, evo_truth)


def evo_numbers(metric, estimate, truth):
    metric.process_data((truth, estimate))
    return metric.get_all_statistics()


def assert_same(statistics, numbers):
    for name in ("rmse", "mean", "median", "std", "min", "max"):
        assert getattr(statistics, name) == pytest.approx(numbers[name], abs=1e-9), name


def test_association(pair):
    for ours, theirs in zip(pair[0], pair[1], strict=True):
        np.testing.assert_allclose(ours.T_world_cam, np.array(theirs.poses_se3), atol=1e-12)


@pytest.mark.parametrize("alignment", ["se3", "sim3", "first", "none"])
def test_absolute_error(pair, alignment):
    ours, (estimate, truth) = pair
    aligned = copy.deepcopy(estimate)
    if alignment in ("se3", "sim3"):
        aligned.align(truth, correct_scale=alignment == "sim3")
    elif alignment == "first":
        aligned.align_origin(truth)
    error = absolute_trajectory_error(*ours, alignment)
    assert_same(error.translation, evo_numbers(metrics.APE(TRANSLATION), aligned, truth))
    assert_same(error.rotation, evo_numbers(metrics.APE(ROTATION), aligned, truth))


@pytest.mark.parametrize("all_pairs", [True, False])
@pytest.mark.parametrize(("delta", "unit"), [(10, "frames"), (1.0, "metres")])
def test_relative_error(pair, delta, unit, all_pairs):
    """The true path chooses overlapping pairs, the estimated path chained ones."""
    ours, (estimate, truth) = pair
    error = relative_pose_error(*ours, delta, unit, all_pairs, pairs_from=ours[all_pairs])
    metric = metrics.RPE(
        TRANSLATION, delta, UNITS[unit], all_pairs=all_pairs, pairs_from_reference=all_pairs
    )
    assert_same(error.translation, evo_numbers(metric, estimate, truth))
    metric.error = np.array([so3_log_angle(so3_from_se3(T)) for T in metric.E])
    assert_same(error.rotation, metric.get_all_statistics())


def test_the_same_file_is_read_alike(shared):
    path = shared / "reference" / "mvsec_indoor_flying1" / "es_ptam.txt"
    ours, theirs = read_tum(path), file_interface.read_tum_trajectory_file(str(path))
    np.testing.assert_allclose(ours.T_world_cam, np.array(theirs.poses_se3), atol=1e-12)
    np.testing.assert_allclose(ours.stamps_ns * 1e-9, theirs.timestamps, atol=1e-6)


def test_umeyama_of_random_trajectories(random_walk):
    """This test runs without the reference files too."""
    ours = random_walk(1), random_walk(2)
    estimate, truth = map(to_evo, ours)
    for scaled in (False, True):
        rotation, translation, scale = copy.deepcopy(estimate).align(truth, correct_scale=scaled)
        found = find_alignment(*ours, "sim3" if scaled else "se3")
        np.testing.assert_allclose(found.rotation, rotation, atol=1e-12)
        np.testing.assert_allclose(found.translation, translation, atol=1e-12)
        assert found.scale == pytest.approx(scale, abs=1e-12)


def test_interpolated_association(shared):
    """The interpolated association gives the error that was published for ESVO on DSEC."""
    folder = shared / "reference" / "dsec_zurich_city_04_a"
    ours = resample(read_tum(folder / "esvo.txt"), read_tum(folder / "stamped_groundtruth.txt"))
    assert absolute_trajectory_error(*ours).translation.rmse == pytest.approx(3.713, abs=5e-4)
