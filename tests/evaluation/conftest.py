"""Trajectories to evaluate: random smooth ones, and the reference files where they are present."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpvo.poses import StampedPoses, rigid_transforms

SHARED = Path(__file__).resolve().parents[3] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of reference trajectories and recordings, which is not part of the project."""
    if not SHARED.is_dir():
        pytest.skip("the folder ../shared with reference trajectories is not there")
    return SHARED


@pytest.fixture(scope="session")
def random_walk() -> Callable[..., StampedPoses]:
    """Factory of smooth random trajectories."""

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
    """Factory of rigid transforms (4, 4)."""

    def transform(seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        rotation = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
        return rigid_transforms(rotation[None], rng.normal(size=(1, 3)))[0]

    return transform
