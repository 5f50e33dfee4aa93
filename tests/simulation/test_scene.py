"""Scenes: depth is exact, and both cameras see the same brightness at a world point."""

import itertools

import numpy as np
import pytest

from gpvo.simulation import SimulationConfig
from gpvo.simulation.motion import Motion
from gpvo.simulation.scene import Scene, pixel_rays

CONFIG = SimulationConfig(seed=4)
K = CONFIG.rig.K_rect


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.random(*CONFIG.room, CONFIG.boxes, np.random.default_rng(4))


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    motion = Motion.random("fast", 6.0, np.random.default_rng(5))
    return motion.pose(np.linspace(0.0, 6.0, 7))


def random_pixels(number: int, margin: float = 0.0) -> np.ndarray:
    low, high = np.zeros(2) - margin, np.array(CONFIG.resolution) - 1.0 + margin
    return np.random.default_rng(6).uniform(low, high, (number, 2))


def world_points(pixels: np.ndarray, depth: np.ndarray, T_world_cam: np.ndarray) -> np.ndarray:
    rays = np.column_stack([pixel_rays(pixels, K), np.ones(len(pixels))])
    return (rays * depth[:, None]) @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]


def distance_to_nearest_face(points: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Return the distance of points to the nearest surface of a box, from inside or outside."""
    low, high = boxes[:, None, 0] - points, points - boxes[:, None, 1]
    outside = np.maximum(low, high)
    return np.abs(outside.max(axis=2)).min(axis=0)


def test_rays_end_on_faces_and_cross_nothing(scene: Scene, poses: np.ndarray) -> None:
    pixels = random_pixels(2000, margin=100.0)
    hit = 0
    for T in poses:
        depth = scene.depth(pixels, K, T)
        points = world_points(pixels, depth, T)
        assert distance_to_nearest_face(points, scene.boxes).max() < 1e-12
        for share in np.linspace(0.0, 0.999, 30):
            on_the_way = world_points(pixels, share * depth, T)[None]
            inside = (on_the_way > scene.boxes[:, None, 0]) & (on_the_way < scene.boxes[:, None, 1])
            assert inside.all(axis=2)[0].all() and not inside.all(axis=2)[1:].any()
        hit += np.count_nonzero(
            scene.depth(pixels, K, T) < Scene(scene.boxes[:1], scene.textures).depth(pixels, K, T)
        )
    assert hit > 100, "no box was in sight, the test has not tested occlusion"


def test_disparity_is_focal_length_times_baseline_over_depth(
    scene: Scene, poses: np.ndarray
) -> None:
    pixels = random_pixels(2000)
    T_left_right = np.eye(4)
    T_left_right[0, 3] = CONFIG.baseline
    for T in poses:
        depth = scene.depth(pixels, K, T)
        disparity = K[0, 0] * CONFIG.baseline / depth
        T_right = T @ T_left_right
        in_right = pixels - np.column_stack([disparity, np.zeros(len(pixels))])
        points = world_points(pixels, depth, T)
        projected = (points - T_right[:3, 3]) @ T_right[:3, :3] @ K.T
        np.testing.assert_allclose(projected[:, :2] / projected[:, 2:], in_right, atol=1e-9)
        seen = np.isclose(scene.depth(in_right, K, T_right), depth, rtol=1e-9)
        assert seen.mean() > 0.9  # the rest is hidden behind a box in one of the images
        # At one level of detail (that of infinitely small pixels) brightness belongs to the point.
        left = scene.look(pixel_rays(pixels, K), 0.0, T)[0]
        right = scene.look(pixel_rays(in_right, K), 0.0, T_right)[0]
        np.testing.assert_allclose(left[seen], right[seen], atol=1e-6)
        assert left.std() > 0.2


def test_rays_along_the_axes_meet_the_walls() -> None:
    """Slopes of exactly 0 and -0 lead to divisions by zero."""
    room = Scene(np.array([[[-3.0, -2.0, -1.0], [4.0, 2.5, 1.5]]]), np.zeros((6, 5, 512, 512), "f"))
    for axis, sign in itertools.product(range(3), (1.0, -1.0)):
        forward, side = sign * np.eye(3)[axis], -np.eye(3)[(axis + 1) % 3]
        T = np.eye(4)
        T[:3, :3] = np.column_stack([side, np.cross(forward, side), forward])
        wall = room.boxes[0, 1, axis] if sign > 0 else -room.boxes[0, 0, axis]
        assert room.depth(K[None, :2, 2], K, T) == wall


def test_boxes_keep_clear_of_the_camera(scene: Scene) -> None:
    room, clear = CONFIG.room
    low, high = scene.boxes[1:, 0], scene.boxes[1:, 1]
    assert len(scene.boxes) == 1 + CONFIG.boxes
    assert (low >= room[0]).all() and (high <= room[1]).all()
    assert ((low > clear[1]) | (high < clear[0])).any(axis=1).all()
