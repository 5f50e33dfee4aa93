"""Distance of a map's landmarks from the true surface of a simulated scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.mapping.landmark_map import LandmarkMap

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SurfaceError:
    """Distances of landmarks from the surface.

    Attributes
    ----------
    landmarks
        Number of landmarks.
    median
        Median distance, metres.
    median_of_depth
        Median distance relative to the landmark's depth.
    """

    landmarks: int
    median: float
    median_of_depth: float

    def __str__(self) -> str:
        return (
            f"map: {self.landmarks} landmarks, median distance to the true surface"
            f" {1e3 * self.median:.1f} mm, {100 * self.median_of_depth:.2f} % of the depth"
        )


def surface_error(found: LandmarkMap, boxes: Array, T_scene_world: Array) -> SurfaceError:
    """Compare a map, one landmark or more, with the surface of boxes.

    Parameters
    ----------
    boxes
        (B, 2, 3) lowest and highest corner in the scene's frame, the first seen from inside.
    T_scene_world
        (4, 4) pose of the map's world in the scene's frame.
    """
    points = found.position @ T_scene_world[:3, :3].T + T_scene_world[:3, 3]
    distance = surface_distance(points, boxes)
    relative = float(np.median(distance / found.depth))
    return SurfaceError(len(found), float(np.median(distance)), relative)


def surface_distance(points: Array, boxes: Array) -> Array:
    """Return the distance (N,) of points (N, 3) from the nearest face of boxes (B, 2, 3)."""
    low, high = boxes[:, None, 0], boxes[:, None, 1]
    outside = np.maximum(np.maximum(low - points, points - high), 0.0)
    beyond = np.linalg.norm(outside, axis=2)
    within = np.minimum(points - low, high - points).min(axis=2)
    return np.asarray(np.where(beyond > 0, beyond, within).min(axis=0))
