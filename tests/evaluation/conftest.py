"""Trajectories to evaluate: random smooth ones, and the reference files if they are present."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from gpvo.trajectory import StampedPoses
from gpvo.trajectory.stamped_poses import rigid_transforms

SHARED = Path(__file__).resolve().parents[3] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """Return the folder of reference trajectories and recordings, outside the project."""
    if not SHARED.is_dir():
        pytest.skip("the folder ../shared with reference trajectories is not there")
    return SHARED


@pytest.fixture(scope="session")
def room1_truth(shared) -> StampedPoses:
    """Return T_world_cam of the rectified left camera of room1_indoor1."""
    recordings = shared / "recordings"
    camchain = yaml.safe_load((recordings / "camchain-imucam-indoor_flying.yaml").read_text())
    T_raw_rect = np.eye(4)
    T_raw_rect[:3, :3] = np.array(camchain["cam0"]["rectification_matrix"]).T
    with h5py.File(recordings / "room1_indoor1_gt.hdf5") as file:
        T_world_raw = file["davis/left/pose"][:]
        stamps_ns = np.round(file["davis/left/pose_ts"][:] * 1e9).astype(np.int64)
    return StampedPoses(stamps_ns, T_world_raw).seen_from(T_raw_rect)


@pytest.fixture(scope="session")
def random_walk() -> Callable[..., StampedPoses]:
    """Return a factory of smooth random trajectories."""

    def walk(seed: int = 0, count: int = 200, step_ns: int = 10_000_000) -> StampedPoses:
        rng = np.random.default_rng(seed)
        velocity = np.cumsum(rng.normal(size=(count, 6)), axis=0)
        twists = np.cumsum(velocity, axis=0) * 1e-3
        stamps = 1_504_645_187_579_542_725 + step_ns * np.arange(count, dtype=np.int64)
        rotations = Rotation.from_rotvec(twists[:, :3]).as_matrix()
        return StampedPoses(stamps, rigid_transforms(rotations, twists[:, 3:]))

    return walk


@pytest.fixture(scope="session")
def random_transform() -> Callable[[int], np.ndarray]:
    """Return a factory of rigid transforms (4, 4)."""

    def transform(seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        rotation = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
        return rigid_transforms(rotation[None], rng.normal(size=(1, 3)))[0]

    return transform
