"""Alignment of an estimate with the ground truth, by the first pose or by least squares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from factors.lie import se3_inverse
from gpvo.errors import require_choice
from gpvo.evaluation.metrics.association import require_associated
from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import rigid_transforms

AlignmentMethod = Literal["se3", "sim3", "yaw", "first", "none"]


@dataclass(frozen=True, eq=False)
class Alignment:
    """Similarity p_new = scale · rotation · p + translation."""

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    scale: float = 1.0

    def apply(self, poses: StampedPoses) -> StampedPoses:
        """Rotate the orientations of poses; scale, rotate and translate their positions."""
        positions = self.scale * poses.positions @ self.rotation.T + self.translation
        rotations = self.rotation @ poses.rotations
        return StampedPoses(poses.stamps_ns, rigid_transforms(rotations, positions))


def find_alignment(
    estimate: StampedPoses, ground_truth: StampedPoses, method: AlignmentMethod = "se3"
) -> Alignment:
    """Find the transform from the estimate's world to the ground truth's.

    Parameters
    ----------
    estimate, ground_truth
        Poses with the same stamps (or associated one to one).
    method
        "se3": least squares over all positions (Umeyama 1991); "sim3": the same with scale;
        "yaw": first poses aligned, then least squares over translation and rotation about the
        world's z axis, for ground truths whose z is vertical; "first": the first poses coincide;
        "none": leave the estimate where it is.

    Raises
    ------
    InputError
        If there is no such method, or the numbers of poses differ.
    """
    require_choice("method", method, AlignmentMethod)
    require_associated(estimate, ground_truth)
    if method == "none":
        return Alignment(np.eye(3), np.zeros(3))
    if method == "first":
        return first_pose_alignment(estimate, ground_truth)
    if method == "yaw":
        return yaw_alignment(estimate, ground_truth)
    return umeyama_alignment(estimate.positions, ground_truth.positions, method == "sim3")


def first_pose_alignment(estimate: StampedPoses, ground_truth: StampedPoses) -> Alignment:
    """Compute the alignment that makes the first poses coincide."""
    T = ground_truth.T_world_cam[0] @ se3_inverse(estimate.T_world_cam[0])
    return Alignment(T[:3, :3], T[:3, 3])


def umeyama_alignment(
    points: NDArray[np.float64], targets: NDArray[np.float64], with_scale: bool = False
) -> Alignment:
    """Compute the least-squares similarity from points (N, 3) to targets (N, 3).

    On a straight path the rotation about the line is not determined; any optimum is returned.
    Source: S. Umeyama, "Least-squares estimation of transformation parameters between two point
    patterns", PAMI 1991, equations 34 to 43.
    """
    centre, target_centre = points.mean(axis=0), targets.mean(axis=0)
    covariance = (targets - target_centre).T @ (points - centre) / len(points)
    rotation = nearest_rotation(covariance)
    scale = 1.0
    if with_scale:
        variance = np.mean(np.sum((points - centre) ** 2, axis=1))
        # At rest the scale is not observable.
        scale = float(np.trace(rotation.T @ covariance) / variance) if variance > 0.0 else 1.0
    return Alignment(rotation, target_centre - scale * rotation @ centre, scale)


def nearest_rotation(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the rotation R that maximises trace(Rᵀ C) for the covariance C = Σ target pointᵀ."""
    U, _, Vt = np.linalg.svd(covariance)
    no_mirror = np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
    return U @ no_mirror @ Vt


def yaw_alignment(estimate: StampedPoses, ground_truth: StampedPoses) -> Alignment:
    """Align the first poses, then fit translation and rotation about world z by least squares."""
    first = first_pose_alignment(estimate, ground_truth)
    points, targets = first.apply(estimate).positions, ground_truth.positions
    centre, target_centre = points.mean(axis=0), targets.mean(axis=0)
    covariance = (targets - target_centre).T @ (points - centre)
    yaw = np.arctan2(covariance[1, 0] - covariance[0, 1], covariance[0, 0] + covariance[1, 1])
    turn = Rotation.from_rotvec([0.0, 0.0, yaw]).as_matrix()
    translation = turn @ (first.translation - centre) + target_centre
    return Alignment(turn @ first.rotation, translation)
