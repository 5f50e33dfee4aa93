"""`gpvo view`: show a result in the viewer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gpvo.commands.watch import Save
from gpvo.errors import InputError
from gpvo.mapping import LandmarkMap
from gpvo.trajectory import Trajectory, read_tum


def view(
    results: Annotated[Path, typer.Argument(help="Result folder.")],
    save: Save = None,
) -> None:
    """Show path, uncertainty, velocities, landmarks and ground truth of a finished run."""
    from gpvo.view.rerun_viewer import RerunViewer  # slow to import

    if not results.is_dir():
        raise InputError(f"{results}: is no result folder; give one that `gpvo run` wrote")
    trajectory = Trajectory.load(results / "trajectory.npz")
    viewer = RerunViewer(save)
    truth = results / "ground_truth.tum"
    if truth.exists():
        viewer.show_truth(read_tum(truth), int(trajectory.stamps_ns(trajectory.start)))
    landmarks = results / "map.npz"
    if landmarks.exists():
        viewer.show_map(LandmarkMap.load(landmarks))
    viewer.show_trajectory(trajectory)
    viewer.wait()
    viewer.close()
