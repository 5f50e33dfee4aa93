"""A textured box room with boxes in it, seen by a pinhole camera: exact depth and brightness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpvo.simulation.textures import LEVELS, TEXELS, random_textures

Array = NDArray[np.float64]

_TEXELS_PER_METRE = 100.0
_WALLS = 6


@dataclass(frozen=True, eq=False)
class Scene:
    """Axis-aligned boxes with textured faces; the first is the room, seen from inside.

    Attributes
    ----------
    boxes
        (B, 2, 3) lowest and highest corner of each box in the world frame (z up), metres.
    textures
        (6, levels, texels, texels) float32, log intensity; face k of box b bears texture b + k.
    """

    boxes: Array
    textures: NDArray[np.float32]

    @staticmethod
    def random(
        room: Array, keep_clear: Array, number_of_boxes: int, rng: np.random.Generator
    ) -> Scene:
        """A room (2, 3) with boxes that stay off the box `keep_clear` (2, 3), both in metres."""
        boxes = [room]
        while len(boxes) <= number_of_boxes:
            low = rng.uniform(room[0], room[1])
            box = np.stack([low, np.minimum(low + rng.uniform(0.3, 0.9, 3), room[1])])
            if (box[0] > keep_clear[1]).any() or (box[1] < keep_clear[0]).any():
                boxes.append(box)
        return Scene(np.stack(boxes), random_textures(_WALLS, rng))

    def look(
        self, rays: Array, pixel_angle: float, T_world_cam: Array
    ) -> tuple[NDArray[np.float32], Array]:
        """Log intensity (N,) and depth (N,) along rays (x, y, 1) of the camera frame.

        Parameters
        ----------
        rays
            (N, 2) x and y of each ray at unit depth.
        pixel_angle
            Width of a pixel at unit depth, 1 / focal length; chooses the level of detail.
        T_world_cam
            (4, 4) pose of the camera, inside the room.
        """
        intensity = np.empty(len(rays), np.float32)
        depth = np.empty(len(rays))
        _look(rays, pixel_angle, T_world_cam, self.boxes, self.textures, intensity, depth)
        return intensity, depth

    def depth(self, pixels: Array, K: Array, T_world_cam: Array) -> Array:
        """Exact depth Z (N,), metres, of (N, 2) pixels of a pinhole camera K (3, 3)."""
        return self.look(pixel_rays(pixels, K), 1.0 / K[0, 0], T_world_cam)[1]


def pixel_rays(pixels: Array, K: Array) -> Array:
    """(N, 2) points at unit depth that are seen at (N, 2) pixels of a pinhole camera K (3, 3)."""
    return (pixels - K[:2, 2]) / np.diag(K)[:2]


def pixel_grid(columns: Array, rows: Array) -> Array:
    """(N, 2) pixels at the crossings of columns and rows, row by row."""
    u, v = np.meshgrid(columns, rows)
    return np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)


@njit(cache=True, error_model="numpy")
def _look(
    rays: Array,
    pixel_angle: float,
    T: Array,
    boxes: Array,
    textures: NDArray[np.float32],
    intensity: NDArray[np.float32],
    depth: Array,
) -> None:
    """Cut every ray with every box (slab method) and look its texture up at the nearest face."""
    slope = np.empty(3)  # of the ray in the world frame, per unit of depth
    for i in range(len(rays)):
        length = 0.0
        for axis in range(3):
            slope[axis] = T[axis, 0] * rays[i, 0] + T[axis, 1] * rays[i, 1] + T[axis, 2]
            length += slope[axis] * slope[axis]
        nearest, nearest_box, nearest_axis = np.inf, 0, 0
        for box in range(len(boxes)):
            enter, leave, enter_axis, leave_axis = -np.inf, np.inf, 0, 0
            for axis in range(3):
                a = (boxes[box, 0, axis] - T[axis, 3]) / slope[axis]
                b = (boxes[box, 1, axis] - T[axis, 3]) / slope[axis]
                if min(a, b) > enter:
                    enter, enter_axis = min(a, b), axis
                if max(a, b) < leave:
                    leave, leave_axis = max(a, b), axis
            if box == 0:
                nearest, nearest_axis = leave, leave_axis
            elif 0.0 < enter < leave and enter < nearest:
                nearest, nearest_box, nearest_axis = enter, box, enter_axis
        across, up = (nearest_axis + 1) % 3, (nearest_axis + 2) % 3
        side = 1 if slope[nearest_axis] > 0.0 else 0
        texture = (nearest_box + 2 * nearest_axis + side) % len(textures)
        pixel = nearest * pixel_angle * np.sqrt(length) / abs(slope[nearest_axis])
        depth[i] = nearest
        intensity[i] = _texture_value(
            textures,
            texture,
            (T[across, 3] + nearest * slope[across]) * _TEXELS_PER_METRE,
            (T[up, 3] + nearest * slope[up]) * _TEXELS_PER_METRE,
            pixel * _TEXELS_PER_METRE,
        )


@njit(cache=True)
def _texture_value(
    textures: NDArray[np.float32], texture: int, column: float, row: float, pixel: float
) -> float:
    """Trilinear value at a texel of a texture, for a pixel that covers so many texels."""
    level, size = 0, max(pixel, 1.0)
    while size > 2.0 and level < LEVELS - 2:
        level, size = level + 1, 0.5 * size
    c, r = int(np.floor(column)), int(np.floor(row))
    u, v = column - c, row - r
    c0, c1, r0, r1 = c % TEXELS, (c + 1) % TEXELS, r % TEXELS, (r + 1) % TEXELS
    fine = _bilinear(textures, texture, level, c0, c1, r0, r1, u, v)
    coarse = _bilinear(textures, texture, level + 1, c0, c1, r0, r1, u, v)
    return fine + min(size - 1.0, 1.0) * (coarse - fine)


@njit(cache=True)
def _bilinear(
    textures: NDArray[np.float32],
    texture: int,
    level: int,
    c0: int,
    c1: int,
    r0: int,
    r1: int,
    u: float,
    v: float,
) -> float:
    top = (1.0 - u) * textures[texture, level, r0, c0] + u * textures[texture, level, r0, c1]
    bottom = (1.0 - u) * textures[texture, level, r1, c0] + u * textures[texture, level, r1, c1]
    return (1.0 - v) * top + v * bottom
