"""Alignment, association, and the offsets between clocks and bodies."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from factors.lie import se3_inverse
from gpvo.errors import InputError
from gpvo.evaluation.metrics.alignment import Alignment, find_alignment
from gpvo.evaluation.metrics.association import associate, nearest_indices, resample, tolerance_for
from gpvo.evaluation.metrics.frame_and_clock_offsets import find_body_offset, find_time_offset
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import rigid_transforms

seeds = st.integers(0, 10_000)


def residual(alignment: Alignment, estimate: StampedPoses, truth: StampedPoses) -> float:
    return float(np.sum((alignment.apply(estimate).positions - truth.positions) ** 2))


@given(seeds)
@settings(deadline=None, max_examples=20)
@pytest.mark.parametrize("method", ["se3", "sim3", "first"])
def test_a_moved_world_is_found(random_walk, random_transform, method, seed):
    estimate = random_walk(seed)
    scale = 1.7 if method == "sim3" else 1.0
    T = random_transform(seed)
    truth = Alignment(T[:3, :3], T[:3, 3], scale).apply(estimate)
    found = find_alignment(estimate, truth, method)
    np.testing.assert_allclose(found.apply(estimate).T_world_cam, truth.T_world_cam, atol=1e-8)
    assert found.scale == pytest.approx(scale)


@given(seeds, seeds)
@settings(deadline=None, max_examples=20)
def test_no_small_change_improves_the_least_squares(random_walk, one, other):
    estimate, truth = random_walk(one), random_walk(other)
    rng = np.random.default_rng(one)
    found = find_alignment(estimate, truth, "se3")
    best = residual(found, estimate, truth)
    for _ in range(5):
        turn = Rotation.from_rotvec(1e-3 * rng.normal(size=3)).as_matrix()
        changed = Alignment(turn @ found.rotation, found.translation + 1e-3 * rng.normal(size=3))
        assert residual(changed, estimate, truth) >= best


def test_yaw_alignment_keeps_the_vertical(random_walk):
    """It finds the best rotation about z."""
    truth = random_walk(1)
    turn = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix()
    drifted = Alignment(turn, np.zeros(3)).apply(truth)
    estimate = StampedPoses(truth.stamps_ns, rigid_transforms(truth.rotations, drifted.positions))
    found = find_alignment(estimate, truth, "yaw")
    np.testing.assert_allclose(found.rotation[2], [0.0, 0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(found.apply(estimate).positions, truth.positions, atol=1e-9)


def test_alignments_are_ordered_by_their_freedom(random_walk):
    estimate, truth = random_walk(3), random_walk(4)
    sums = [residual(find_alignment(estimate, truth, m), estimate, truth) for m in
            ("sim3", "se3", "yaw", "first")]  # fmt: skip
    assert sums == sorted(sums)


def test_a_platform_at_rest_can_be_aligned():
    still = StampedPoses(np.arange(5), np.tile(np.eye(4), (5, 1, 1)))
    for method in ("se3", "sim3", "yaw", "first", "none"):
        assert residual(find_alignment(still, still, method), still, still) == 0.0


@given(
    st.lists(st.integers(-1000, 1000), min_size=1, max_size=20),
    st.lists(st.integers(-1000, 1000), min_size=1, max_size=20, unique=True),
)
@settings(deadline=None)
def test_nearest_is_the_nearest(stamps, among):
    among = np.sort(among)
    found = np.abs(among[nearest_indices(np.array(stamps), among)] - stamps)
    expected = np.abs(among[:, None] - stamps).min(axis=0)
    np.testing.assert_array_equal(found, expected)


def test_association_is_symmetric_and_bounded(random_walk):
    dense, sparse = random_walk(0, 200), random_walk(1, 30, 47_000_000)
    one, other = associate(dense, sparse, 0.003), associate(sparse, dense, 0.003)
    np.testing.assert_array_equal(one[0].T_world_cam, other[1].T_world_cam)
    np.testing.assert_array_equal(one[1].T_world_cam, other[0].T_world_cam)
    assert set(one[0].stamps_ns) <= set(sparse.stamps_ns)
    assert 0 < len(one[0]) < len(sparse)


def test_what_has_nothing_in_common_is_rejected(random_walk):
    poses = random_walk()
    late = StampedPoses(poses.stamps_ns + 10**10, poses.T_world_cam)
    for pairing in (associate, resample):
        with pytest.raises(InputError, match="same clock"):
            pairing(poses, late)


def test_the_tolerance_follows_a_sparse_ground_truth(random_walk):
    assert tolerance_for(random_walk()) == 0.02
    assert tolerance_for(random_walk(step_ns=200_000_000)) == pytest.approx(0.06)


@pytest.mark.parametrize("offset", [-0.0471, 0.0, 0.0123])
def test_a_clock_offset_is_found(random_walk, random_transform, offset):
    """The offset does not depend on world frame and scale."""
    truth = random_walk(5, 500)
    scaled = rigid_transforms(truth.rotations, 0.8 * truth.positions)
    early = StampedPoses(truth.stamps_ns - round(offset * 1e9), scaled)
    found = find_time_offset(early.in_world(random_transform(1)), truth)
    assert found == pytest.approx(offset, abs=2e-4)


def test_a_clock_offset_out_of_reach_is_not_invented(random_walk):
    truth = random_walk(5, 500)
    late = StampedPoses(truth.stamps_ns + 200_000_000, truth.T_world_cam)
    with pytest.raises(InputError, match="no clear time offset"):
        find_time_offset(late, truth)


@pytest.mark.parametrize("lever_arm", [False, True])
def test_a_body_offset_is_found(random_walk, random_transform, lever_arm):
    truth = random_walk(6)
    T_truth_estimate = random_transform(7)
    if not lever_arm:
        T_truth_estimate[:3, 3] = 0.0
    estimate = truth.seen_from(T_truth_estimate).in_world(random_transform(8))
    found = find_body_offset(estimate, truth, lever_arm)
    np.testing.assert_allclose(found, T_truth_estimate, atol=1e-4)


def test_no_lever_arm_is_invented_where_nothing_turns(random_walk):
    positions = random_walk(9).positions
    still = np.broadcast_to(np.eye(3), (len(positions), 3, 3))
    truth = StampedPoses(np.arange(len(positions)), rigid_transforms(still, positions))
    found = find_body_offset(truth, truth, lever_arm=True)
    np.testing.assert_allclose(found, np.eye(4), atol=1e-9)
    assert np.isfinite(se3_inverse(found)).all()
