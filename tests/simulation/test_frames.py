"""Frames are close enough in time that image points hardly move between them."""

from itertools import pairwise

import numpy as np
import pytest

from gpvo.simulation import SimulationConfig
from gpvo.simulation.events import frame_times
from gpvo.simulation.motion import Motion, MotionName
from gpvo.simulation.scene import Scene, pixel_grid, pixel_rays


@pytest.mark.parametrize("name", ["hand_held", "fast", "rotation", "corridor", "still"])
def test_image_points_move_less_than_the_step_between_frames(name: MotionName) -> None:
    config = SimulationConfig(motion=name, duration=0.8)
    scene = Scene.random(*config.room, config.boxes, np.random.default_rng(1))
    motion = Motion.random(name, config.duration, np.random.default_rng(2))
    times = frame_times(scene, motion, config)
    assert times[0] == 0.0 and times[-1] == config.duration
    assert (np.diff(times) > 0.0).all() and np.diff(times).max() < 0.0101

    K, poses = config.rig.K_rect, motion.pose(times)
    pixels = pixel_grid(np.linspace(0.0, 345.0, 20), np.linspace(0.0, 259.0, 15))
    rays = np.column_stack([pixel_rays(pixels, K), np.ones(len(pixels))])
    largest = []
    for before, after in pairwise(poses):
        points = rays * scene.depth(pixels, K, before)[:, None]
        world = points @ before[:3, :3].T + before[:3, 3]
        moved = (world - after[:3, 3]) @ after[:3, :3] @ K.T
        motion_in_image = moved[:, :2] / moved[:, 2:] - pixels
        largest.append(np.linalg.norm(motion_in_image, axis=1).max())
    assert np.max(largest) < 1.1 * config.pixels_per_frame
    if name != "still":
        assert np.mean(largest) > 0.8 * config.pixels_per_frame
