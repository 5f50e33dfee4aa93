"""The paper's errors: identities, invariances and a hand-made case."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import logm
from scipy.spatial.transform import Rotation

from factors.lie import se3_inverse
from gpvo.evaluation.metrics.paper_errors import (
    COMPONENTS,
    err,
    from_first_pose,
    global_error,
    motion_integrals,
    relative_error,
)
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import rigid_transforms

seeds = st.integers(0, 10_000)


def vee(matrix: np.ndarray) -> np.ndarray:
    """Return the twist, rotation first, of a matrix of se(3)."""
    return np.array([matrix[2, 1], matrix[0, 2], matrix[1, 0], *matrix[:3, 3]])


def test_err_is_the_papers_formula(random_transform):
    """It equals the matrix logarithm, with the paper's T_{k,1} (world to camera) as input."""
    T_k1, T_l1, G_k1, G_l1 = (random_transform(seed) for seed in range(4))
    T_lk, G_lk = T_l1 @ np.linalg.inv(T_k1), G_l1 @ np.linalg.inv(G_k1)
    C = random_transform(5)
    expected = vee(logm(C @ T_lk @ np.linalg.inv(C) @ np.linalg.inv(G_lk)).real)
    np.testing.assert_allclose(err(T_lk[None], G_lk[None], C[None])[0], expected, atol=1e-10)


@given(seeds, seeds)
@settings(deadline=None, max_examples=10)
def test_global_error_is_the_true_body_seen_from_the_estimated_one(random_walk, one, other):
    """With aligned first poses err(t_k, t_1) = ln T_{k_gt,k}."""
    estimate, truth = random_walk(one, 6), random_walk(other, 6)
    T_gt_est = se3_inverse(from_first_pose(truth)) @ from_first_pose(estimate)
    twists = global_error(estimate, truth).twists
    for twist, T in zip(twists, T_gt_est, strict=True):
        np.testing.assert_allclose(twist, vee(logm(T).real), atol=1e-7)


@given(seeds, seeds)
@settings(deadline=None, max_examples=20)
def test_the_choice_of_worlds_does_not_matter(random_walk, random_transform, one, other):
    estimate, truth = random_walk(one, 30), random_walk(other, 30)
    A, B = random_transform(one), random_transform(other + 1)
    for aligned_at in ("step", "first pose"):
        here = relative_error(estimate, truth, aligned_at).twists
        there = relative_error(estimate.in_world(A), truth.in_world(B), aligned_at).twists
        np.testing.assert_allclose(here, there, atol=1e-8)
    here = global_error(estimate, truth).twists
    there = global_error(estimate.in_world(A), truth.in_world(B)).twists
    np.testing.assert_allclose(here, there, atol=1e-8)


def test_a_perfect_estimate_has_no_error(random_walk, random_transform):
    truth = random_walk()
    estimate = truth.in_world(random_transform(1))
    for errors in (global_error(estimate, truth), relative_error(estimate, truth)):
        for part in COMPONENTS:
            assert errors.statistics(part).max < 1e-7


def test_a_known_drift_gives_known_numbers():
    """The true path is 10 steps of 1 m straight ahead, the estimated one is 10 % shorter."""
    stamps = np.arange(11, dtype=np.int64)
    positions = np.outer(np.arange(11.0), [0.0, 0.0, 1.0])
    rotations = np.broadcast_to(np.eye(3), (11, 3, 3))
    truth = StampedPoses(stamps, rigid_transforms(rotations, positions))
    estimate = StampedPoses(stamps, rigid_transforms(rotations, 0.9 * positions))
    since_start = global_error(estimate, truth).statistics("translation")
    assert since_start.max == pytest.approx(1.0)
    assert since_start.final_percent == pytest.approx(10.0)
    assert since_start.max_percent == pytest.approx(10.0)
    assert since_start.rms == pytest.approx(np.sqrt(np.mean(np.linspace(0, 1, 11) ** 2)))
    assert since_start.std == pytest.approx(np.linspace(0, 1, 11).std())
    per_step = relative_error(estimate, truth).statistics("se3")
    assert per_step.rms == pytest.approx(0.1)
    assert per_step.std == pytest.approx(0.0, abs=1e-12)


def test_drift_enters_the_relative_error_only_with_its_lever_arm():
    """After a lost metre, a pure turn is a step without error, unless the drift is carried."""
    stamps = np.arange(3, dtype=np.int64)
    turn = Rotation.from_rotvec([[0, 0, 0], [0, 0, 0], [0, 0.1, 0]]).as_matrix()
    truth = StampedPoses(
        stamps, rigid_transforms(turn, np.array([[0, 0, 0], [0, 0, 1], [0, 0, 1]]))
    )
    estimate = StampedPoses(stamps, rigid_transforms(turn, np.zeros((3, 3))))
    own = relative_error(estimate, truth, "step").norms["translation"]
    carried = relative_error(estimate, truth, "first pose").norms["translation"]
    np.testing.assert_allclose(own, [1.0, 0.0], atol=1e-12)
    assert carried[1] == pytest.approx(0.1, rel=0.01)


def test_motion_integrals_of_a_screw():
    """Ten steps of one constant twist travel ten times its norms."""
    stamps = np.arange(11, dtype=np.int64)
    angles = 0.1 * np.arange(11)
    rotations = Rotation.from_rotvec(np.outer(angles, [0, 0, 1])).as_matrix()
    poses = StampedPoses(stamps, rigid_transforms(rotations, np.outer(angles, [0, 0, 2.0])))
    motion = motion_integrals(poses)
    assert motion["rotation"] == pytest.approx(1.0)
    assert motion["translation"] == pytest.approx(2.0)
    assert motion["se3"] == pytest.approx(np.sqrt(5.0))
