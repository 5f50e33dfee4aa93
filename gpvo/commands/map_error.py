"""Compare a result's map with the true surface, where a simulation left it."""

from __future__ import annotations

from pathlib import Path

from gpvo.errors import InputError
from gpvo.evaluation.metrics.gp_interpolation import interpolate_by_gp
from gpvo.mapping import LandmarkMap
from gpvo.mapping.scene_file import read_scene, scene_beside
from gpvo.mapping.surface_error import SurfaceError, surface_error
from gpvo.trajectory import Trajectory, read_tum


def map_error(result: Path, ground_truth: Path | None = None) -> SurfaceError | None:
    """Compare the map of a result folder; None if the scene, the truth or the map is not known.

    The first pose of the trajectory is taken for the true one, so that its drift is in the error.

    Raises
    ------
    InputError
        If a file cannot be used.
    """
    scene = scene_beside(result, ground_truth)
    truth = result / "ground_truth.tum"
    if scene is None or not truth.is_file() or not (result / "map.npz").is_file():
        return None
    found, boxes = LandmarkMap.load(result / "map.npz"), read_scene(scene)
    if len(found) == 0:
        return None
    trajectory = Trajectory.load(result / "trajectory.npz")
    try:
        first = interpolate_by_gp(read_tum(truth), trajectory.stamps_ns([trajectory.start]))
    except InputError:
        return None  # the truth begins later
    return surface_error(found, boxes, first.T_world_cam[0])
