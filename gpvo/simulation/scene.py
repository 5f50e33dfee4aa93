"""Textured room with boxes, seen by a pinhole camera: exact depth and brightness."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.simulation.textures import LEVELS, TEXELS, random_textures

Array = NDArray[np.float64]

_TEXELS_PER_METRE = 50.0
_WALLS = 6
_MASK = TEXELS - 1
_CENTRE = TEXELS / 2
"""Texel at the world's origin, far from the texture's border, where shapes are cut."""

_VERTICES = np.array(list(product((0, 1), repeat=3)))
"""(8, 3), whether each vertex of a box has the lowest (0) or highest (1) x, y and z."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Axis-aligned boxes with textured faces; the first is the room, seen from inside.

    Attributes
    ----------
    boxes
        (B, 2, 3) lowest and highest corner of each box in the world frame (z up), metres.
    textures
        (6, levels, texels, texels) float32, log intensity; face k of box b has texture
        (b + k) mod 6.
    """

    boxes: Array
    textures: NDArray[np.float32]

    @staticmethod
    def random(
        room: Array, keep_clear: Array, number_of_boxes: int, rng: np.random.Generator
    ) -> Scene:
        """Draw a room (2, 3) with boxes outside of the box `keep_clear` (2, 3), both in metres."""
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
        """Return log intensity (N,) and depth (N,) along rays (x, y, 1) of the camera frame.

        Parameters
        ----------
        rays
            (N, 2) x and y of each ray at unit depth.
        pixel_angle
            Width of a pixel at unit depth, 1 / focal length; determines the level of detail.
        T_world_cam
            (4, 4) pose of the camera, inside the room.
        """
        intensity = np.empty(len(rays), np.float32)
        depth = np.empty(len(rays))
        R, position = np.ascontiguousarray(T_world_cam[:3, :3]), T_world_cam[:3, 3].copy()
        corners = self.boxes - position
        bounds = _image_bounds(corners, R)
        _look(rays, pixel_angle, R, position, corners, bounds, self.textures, intensity, depth)
        return intensity, depth

    def depth(self, pixels: Array, K: Array, T_world_cam: Array) -> Array:
        """Return the exact depth Z (N,), metres, of pixels (N, 2) of a pinhole camera K (3, 3)."""
        return self.look(pixel_rays(pixels, K), 1.0 / K[0, 0], T_world_cam)[1]


def _image_bounds(corners: Array, R_world_cam: Array) -> Array:
    """Return the lowest and highest x and y at unit depth of boxes, (B, 2, 2).

    `corners` are relative to the camera's position, in axes of the world. Boxes behind the camera
    get empty bounds, those partly behind it unlimited ones.
    """
    points = corners[:, _VERTICES, np.arange(3)] @ R_world_cam
    in_front = points[:, :, 2] > 0.0
    bounds = np.empty((len(corners), 2, 2))
    bounds[:] = np.array([[-np.inf], [np.inf]])
    bounds[~in_front.any(axis=1)] = np.array([[np.inf], [-np.inf]])
    seen = in_front.all(axis=1)
    projected = points[seen, :, :2] / points[seen, :, 2:]
    bounds[seen] = np.stack([projected.min(axis=1), projected.max(axis=1)], axis=1)
    return bounds


def pixel_rays(pixels: Array, K: Array) -> Array:
    """Return points (N, 2) at unit depth that a pinhole camera K (3, 3) sees at pixels (N, 2)."""
    return (pixels - K[:2, 2]) / np.diag(K)[:2]


def pixel_grid(columns: Array, rows: Array) -> Array:
    """Return pixels (N, 2) at the crossings of columns and rows, row by row."""
    u, v = np.meshgrid(columns, rows)
    return np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)


@kernel
def _look(
    rays: Array,
    pixel_angle: float,
    R: Array,
    position: Array,
    corners: Array,
    bounds: Array,
    textures: NDArray[np.float32],
    intensity: NDArray[np.float32],
    depth: Array,
) -> None:
    """Intersect every ray with every box (slab method) and sample the texture of the nearest face.

    `corners` are those of the boxes relative to the camera's position, in axes of the world.
    """
    slope, inverse = np.empty(3), np.empty(3)  # metres of world per metre of depth
    far = np.empty(3, np.int64)  # the corner on whose side the ray leaves
    for i in range(len(rays)):
        squared_length = 0.0
        nearest, nearest_box, nearest_axis = np.inf, 0, 0
        for axis in range(3):
            slope[axis] = R[axis, 0] * rays[i, 0] + R[axis, 1] * rays[i, 1] + R[axis, 2]
            inverse[axis] = 1.0 / slope[axis]
            far[axis] = 1 if inverse[axis] > 0.0 else 0  # also correct for slopes of 0 and -0
            squared_length += slope[axis] * slope[axis]
            wall = corners[0, far[axis], axis] * inverse[axis]
            if wall < nearest:
                nearest, nearest_axis = wall, axis
        for box in range(1, len(corners)):
            if not (bounds[box, 0, 0] <= rays[i, 0] <= bounds[box, 1, 0]):
                continue
            if not (bounds[box, 0, 1] <= rays[i, 1] <= bounds[box, 1, 1]):
                continue
            enter, leave, enter_axis = 0.0, nearest, -1
            for axis in range(3):
                a = corners[box, 1 - far[axis], axis] * inverse[axis]
                b = corners[box, far[axis], axis] * inverse[axis]
                if a > enter:
                    enter, enter_axis = a, axis
                if b < leave:
                    leave = b
            if enter < leave and enter_axis >= 0:
                nearest, nearest_box, nearest_axis = enter, box, enter_axis
        across, up = (nearest_axis + 1) % 3, (nearest_axis + 2) % 3
        pixel = nearest * pixel_angle * np.sqrt(squared_length) * abs(inverse[nearest_axis])
        depth[i] = nearest
        intensity[i] = _texture_value(
            textures,
            (nearest_box + 2 * nearest_axis + far[nearest_axis]) % len(textures),
            (position[across] + nearest * slope[across]) * _TEXELS_PER_METRE + _CENTRE,
            (position[up] + nearest * slope[up]) * _TEXELS_PER_METRE + _CENTRE,
            pixel * _TEXELS_PER_METRE,
        )


@kernel
def _texture_value(
    textures: NDArray[np.float32], index: int, column: float, row: float, pixel: float
) -> float:
    """Return a texture's trilinear value at a texel, for a pixel that covers `pixel` texels."""
    level = 0
    while pixel > 2.0 and level < LEVELS - 2:
        level, pixel = level + 1, 0.5 * pixel
    fine = _bilinear(textures, index, level, column, row)
    if pixel <= 1.0:
        return fine
    return fine + min(pixel - 1.0, 1.0) * (
        _bilinear(textures, index, level + 1, column, row) - fine
    )


@kernel
def _bilinear(
    textures: NDArray[np.float32], index: int, level: int, column: float, row: float
) -> float:
    left, top = int(np.floor(column)), int(np.floor(row))
    u, v = np.float32(column - left), np.float32(row - top)
    c0, c1, r0, r1 = (left & _MASK, (left + 1) & _MASK, top & _MASK, (top + 1) & _MASK)
    upper_left, lower_left = textures[index, level, r0, c0], textures[index, level, r1, c0]
    upper = upper_left + u * (textures[index, level, r0, c1] - upper_left)
    lower = lower_left + u * (textures[index, level, r1, c1] - lower_left)
    return upper + v * (lower - upper)
