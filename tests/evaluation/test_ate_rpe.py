"""Relative errors by distance: pairs, segments and summaries."""

import numpy as np
import pytest

from gpvo.errors import InputError
from gpvo.evaluation.metrics.ate_rpe import pose_pairs, relative_pose_error
from gpvo.evaluation.metrics.kitti_segments import KITTI_LENGTHS, segment_errors
from gpvo.evaluation.metrics.statistics import Statistics
from gpvo.trajectory import StampedPoses


def test_relative_error_does_not_depend_on_the_worlds(random_walk, random_transform):
    estimate, truth = random_walk(1), random_walk(2)
    here = relative_pose_error(estimate, truth, 0.5, "seconds")
    there = relative_pose_error(estimate.in_world(random_transform(3)), truth, 0.5, "seconds")
    assert there.translation.rmse == pytest.approx(here.translation.rmse, abs=1e-9)
    assert there.rotation.rmse == pytest.approx(here.rotation.rmse, abs=1e-9)


@pytest.mark.parametrize("all_pairs", [True, False])
def test_seconds_are_frames_on_a_regular_clock(random_walk, all_pairs):
    """Near the end overlapping pairs may also be a tenth shorter."""
    poses = random_walk(1)  # 10 ms between poses
    frames = np.array(pose_pairs(poses, 30, "frames", all_pairs))
    seconds = np.array(pose_pairs(poses, 0.3, "seconds", all_pairs))
    np.testing.assert_array_equal(seconds[:, : frames.shape[1]], frames)
    assert seconds.shape[1] - frames.shape[1] == (3 if all_pairs else 0)


def test_overlapping_pairs_are_nearest_by_exhaustive_search(random_walk):
    poses = random_walk(3, 120)
    steps = np.linalg.norm(np.diff(poses.positions, axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    delta = 0.2 * travelled[-1]
    first, last = pose_pairs(poses, delta, "metres", all_pairs=True)
    expected = []
    for i in range(len(poses) - 1):
        misses = np.abs(travelled[i + 1 :] - travelled[i] - delta)
        if misses.min() <= 0.1 * delta:
            expected.append((i, i + 1 + int(np.argmin(misses))))
    assert list(zip(first, last, strict=True)) == expected


@pytest.mark.parametrize(
    ("delta", "unit"),
    [(0.0, "metres"), (-1.0, "seconds"), (1.5, "frames"), (np.inf, "frames"), (np.inf, "metres")],
)
def test_impossible_distances_are_rejected(random_walk, delta, unit):
    with pytest.raises(InputError, match="RPE over"):
        relative_pose_error(random_walk(), random_walk(), delta, unit)


def test_a_distance_longer_than_the_path_gives_no_number(random_walk):
    error = relative_pose_error(random_walk(), random_walk(), 1e6, "metres")
    assert error.translation.count == 0
    assert np.isnan(error.rotation.rmse)


def kitti_devkit(estimate: np.ndarray, truth: np.ndarray, lengths: list[float]) -> dict:
    """Compute the errors with the loops of KITTI's development kit, segment by segment."""
    travelled = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))]
    )
    errors: dict = {length: [] for length in lengths}
    for first in range(0, len(truth), 10):
        for length in lengths:
            further = np.flatnonzero(travelled > travelled[first] + length)
            if len(further):
                last = further[0]
                true_motion = np.linalg.inv(truth[first]) @ truth[last]
                motion = np.linalg.inv(estimate[first]) @ estimate[last]
                error = np.linalg.inv(motion) @ true_motion
                angle = np.arccos(np.clip(0.5 * (np.trace(error[:3, :3]) - 1.0), -1.0, 1.0))
                errors[length].append((np.linalg.norm(error[:3, 3]) / length, angle / length))
    return errors


def test_segment_errors_are_kittis(random_walk):
    estimate, truth = random_walk(4, 300), random_walk(5, 300)
    path = np.linalg.norm(np.diff(truth.positions, axis=0), axis=1).sum()
    lengths = [0.1 * path, 0.3 * path, 2.0 * path]
    expected = kitti_devkit(estimate.T_world_cam, truth.T_world_cam, lengths)
    found = segment_errors(estimate, truth, lengths)
    assert [error.length for error in found] == lengths[:2]
    for error in found:
        translation, rotation = np.mean(expected[error.length], axis=0)
        assert error.count == len(expected[error.length])
        assert error.translation_percent == pytest.approx(100 * translation)
        assert error.rotation_deg_per_m == pytest.approx(np.degrees(rotation), abs=1e-6)


def test_long_paths_are_cut_into_kittis_lengths(random_walk):
    walk = random_walk(6)
    steps = np.linalg.norm(np.diff(walk.positions, axis=0), axis=1)
    far = walk.T_world_cam.copy()
    far[:, :3, 3] *= 1000.0 / steps.sum()
    truth = StampedPoses(walk.stamps_ns, far)
    lengths = [error.length for error in segment_errors(truth, truth, start_every=1)]
    assert lengths == list(KITTI_LENGTHS)


def test_statistics_by_hand():
    statistics = Statistics.of(np.array([3.0, 4.0, 0.0]))
    assert statistics.rmse == pytest.approx(np.sqrt(25 / 3))
    assert (statistics.min, statistics.median, statistics.max) == (0.0, 3.0, 4.0)
    assert statistics.count == 3
