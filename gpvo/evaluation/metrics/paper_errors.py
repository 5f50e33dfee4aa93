"""The paper's global and relative error (section IV-A).

The paper's T_{n,m} takes points from frame m to frame n, so in our convention
T_{n,m} = T_world_n⁻¹ T_world_m, for estimate and ground truth alike. One equation gives both:

    err(t_m, t_n) = ln(T_{m_gt,m} T_{n,m} T_{m_gt,m}⁻¹ T_{n_gt,m_gt}⁻¹)

where T_{m_gt,m} is the estimated frame m seen from the true one. Twists are rotation first.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from factors.lie import se3_inverse, se3_log
from gpvo.errors import require_choice
from gpvo.evaluation.metrics.association import require_associated
from gpvo.trajectory import StampedPoses

Component = Literal["translation", "rotation", "se3"]
COMPONENTS: tuple[Component, ...] = ("translation", "rotation", "se3")
FrameTransform = Literal["step", "first pose"]


def err(
    T_n_m: NDArray[np.float64], T_n_m_gt: NDArray[np.float64], T_gt_est: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute the paper's err(t_m, t_n) as twists (N, 6), rotation first.

    Parameters
    ----------
    T_n_m, T_n_m_gt
        (N, 4, 4) transforms from frame m to frame n, estimated and true.
    T_gt_est
        (N, 4, 4) transforms from the estimated frame m to the true frame m, T_{m_gt,m}.
    """
    in_true_frame = T_gt_est @ T_n_m @ se3_inverse(T_gt_est)
    return se3_log(in_true_frame @ se3_inverse(T_n_m_gt))


def global_error(estimate: StampedPoses, ground_truth: StampedPoses) -> PoseErrors:
    """Compute the global error GE(t_k) = err(t_k, t_1) since the aligned first pose.

    Both must have the same stamps. With the worlds aligned at the first pose, T_{k_gt,k} is the
    whole error at t_k and the equation reduces to its logarithm.
    """
    require_associated(estimate, ground_truth)
    T_1_k, T_1_k_gt = from_first_pose(estimate), from_first_pose(ground_truth)
    T_gt_est = se3_inverse(T_1_k_gt) @ T_1_k
    return PoseErrors(err(T_1_k, T_1_k_gt, T_gt_est), motion_integrals(ground_truth))


def relative_error(
    estimate: StampedPoses, ground_truth: StampedPoses, aligned_at: FrameTransform = "step"
) -> PoseErrors:
    """Compute the relative error RE(t_k) = err(t_k, t_{k-1}) of each of the N - 1 steps.

    Parameters
    ----------
    estimate, ground_truth
        Poses with the same stamps.
    aligned_at
        Choice of T_{k_gt,k}. With "step" every step starts with estimate and truth aligned:
        T_{k_gt,k} = 1, and only the step's own error counts. With "first pose" it is the error
        accumulated until t_k, which adds the drift's lever arm times the step's rotation.
    """
    require_choice("aligned_at", aligned_at, FrameTransform)
    require_associated(estimate, ground_truth)
    T_1_k, T_1_k_gt = from_first_pose(estimate), from_first_pose(ground_truth)
    if aligned_at == "step":
        T_gt_est = np.broadcast_to(np.eye(4), T_1_k[1:].shape)
    else:
        T_gt_est = (se3_inverse(T_1_k_gt) @ T_1_k)[1:]
    twists = err(steps(T_1_k), steps(T_1_k_gt), T_gt_est)
    return PoseErrors(twists, motion_integrals(ground_truth))


def from_first_pose(poses: StampedPoses) -> NDArray[np.float64]:
    """Return the transforms T_{1,k} (N, 4, 4) from camera k to the first camera."""
    return se3_inverse(poses.T_world_cam[:1]) @ poses.T_world_cam


def steps(T_world_cam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the transforms T_{k-1,k} (N - 1, 4, 4) between consecutive poses."""
    return se3_inverse(T_world_cam[:-1]) @ T_world_cam[1:]


def motion_integrals(poses: StampedPoses) -> dict[Component, float]:
    """Compute the integrated norms of the motion: path length (m), rotation (rad), SE(3) norm."""
    path_length = np.linalg.norm(np.diff(poses.positions, axis=0), axis=1).sum()
    twists = se3_log(steps(poses.T_world_cam))
    return {
        "translation": float(path_length),
        "rotation": float(np.linalg.norm(twists[:, :3], axis=1).sum()),
        "se3": float(np.linalg.norm(twists, axis=1).sum()),
    }


@dataclass(frozen=True)
class PaperStatistics:
    """The columns of the paper's tables: metres for translation, radians for rotation."""

    max: float
    max_percent: float
    final_percent: float
    rms: float
    std: float


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """A series of errors, and the true motion that percentages refer to.

    Attributes
    ----------
    twists
        (N, 6) rotation (rad) and translation (m).
    motion
        Integrated norm of the ground truth's motion for each component.
    """

    twists: NDArray[np.float64]
    motion: dict[Component, float]

    @cached_property
    def norms(self) -> dict[Component, NDArray[np.float64]]:
        """(N,) norms of the error for each component."""
        return {
            "translation": np.linalg.norm(self.twists[:, 3:], axis=1),
            "rotation": np.linalg.norm(self.twists[:, :3], axis=1),
            "se3": np.linalg.norm(self.twists, axis=1),
        }

    def statistics(self, component: Component) -> PaperStatistics:
        """Compute maximum, RMS, standard deviation and percentages (NaN for a truth at rest)."""
        norms, motion = self.norms[component], self.motion[component]
        percent = 100.0 / motion if motion > 0.0 else np.nan
        return PaperStatistics(
            max=float(norms.max()),
            max_percent=float(norms.max() * percent),
            final_percent=float(norms[-1] * percent),
            rms=float(np.sqrt(np.mean(norms**2))),
            std=float(norms.std()),
        )

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Return the statistics of every component as plain numbers."""
        return {component: asdict(self.statistics(component)) for component in COMPONENTS}
