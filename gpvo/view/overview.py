"""The first look at a result in one figure, in a style that could go into a paper."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from numpy.typing import NDArray

from gpvo.evaluation import Evaluation
from gpvo.evaluation.report.figures import COLOURS, TRUTH_COLOUR, label_axes, new_figure
from gpvo.trajectory import Trajectory
from gpvo.view.keeper import BestPicture

Array = NDArray[np.float64]

AXES = ("x", "y", "z")
SAMPLES = 400
"""Number of times at which curves are drawn."""
ELLIPSES = 12
"""Number of ellipses along the path."""


def overview_figure(
    trajectory: Trajectory, best: BestPicture, evaluation: Evaluation | None = None
) -> Figure:
    """Draw the path, an event image with tracks, velocities, and errors or uncertainty."""
    figure = new_figure(10.0, 6.6)
    columns = figure.add_gridspec(1, 2, width_ratios=[1.0, 1.15])
    left, right = (figure.add_subfigure(columns[0, k]) for k in range(2))
    path, picture = left.subplots(2, 1, height_ratios=[1.15, 1.0])
    linear, angular, last = right.subplots(3, 1, sharex=True)
    _path(path, trajectory, evaluation)
    _picture(picture, best)
    t = np.linspace(trajectory.start, trajectory.stop, SAMPLES)
    _velocity(linear, trajectory, t, 3, "velocity [m/s]")
    _velocity(angular, trajectory, t, 0, "angular velocity [rad/s]")
    if evaluation is None:
        _uncertainty(last, trajectory, t)
    else:
        _errors(last, evaluation, trajectory)
    for axes in (path, linear, angular, last):
        axes.margins(x=0.01)
    linear.legend(loc="upper right", ncols=3, frameon=False, fontsize=8)
    last.set_xlabel("time [s]")
    return figure


def _path(axes: Axes, trajectory: Trajectory, evaluation: Evaluation | None) -> None:
    """Draw the path from above, with ellipses of 3 standard deviations."""
    if evaluation is not None:
        truth = _truth_positions(trajectory, evaluation)
        axes.plot(truth[:, 0], truth[:, 2], color=TRUTH_COLOUR, linewidth=2.2, label="truth")
    T = trajectory.pose(np.linspace(trajectory.start, trajectory.stop, 2000))
    axes.plot(T[:, 0, 3], T[:, 2, 3], color=COLOURS[0], linewidth=1.4, label="gpvo")
    for t in np.linspace(trajectory.start, trajectory.stop, ELLIPSES):
        axes.add_patch(_ellipse(trajectory, float(t)))
    axes.plot([], [], color=COLOURS[1], linewidth=0.8, label="3 sigma")
    axes.plot(T[0, 0, 3], T[0, 2, 3], "o", color="black", markersize=4)
    axes.set_aspect("equal", adjustable="datalim")
    label_axes(axes, "right [m]", "forward [m]")
    axes.legend(loc="best", frameon=False, fontsize=8)


def _truth_positions(trajectory: Trajectory, evaluation: Evaluation) -> Array:
    """Return the true positions (N, 3) in the trajectory's world, as they were aligned."""
    estimate = evaluation.estimate
    t = (int(estimate.stamps_ns[0]) - trajectory.start_ns) * 1e-9
    first = trajectory.pose(np.clip(t, trajectory.start, trajectory.stop))
    return evaluation.ground_truth.in_world(
        first @ np.linalg.inv(estimate.T_world_cam[0])
    ).positions


def _ellipse(trajectory: Trajectory, t: float) -> Ellipse:
    """Return the ellipse of 3 standard deviations of the position from above."""
    T, covariance = trajectory.pose(t), trajectory.covariance(t)
    world = T[:3, :3] @ covariance[3:6, 3:6] @ T[:3, :3].T
    values, vectors = np.linalg.eigh(world[np.ix_([0, 2], [0, 2])])
    width, height = 6 * np.sqrt(np.clip(values, 0, None))
    angle = np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0]))
    centre = T[0, 3], T[2, 3]
    return Ellipse(centre, width, height, angle=angle, fill=False, color=COLOURS[1], linewidth=0.8)


def _picture(axes: Axes, best: BestPicture) -> None:
    axes.set_axis_off()
    image, tracks = best.image, best.tracks
    if image is None or tracks is None:
        return
    axes.imshow(image, interpolation="nearest")
    lines = LineCollection(list(tracks.left), colors=tracks.colours / 255, linewidths=0.9)
    axes.add_collection(lines)
    title = f"left events at {best.t:.2f} s, {tracks.inliers.sum()} inlier tracks (green)"
    axes.set_title(f"{title}, others red", fontsize=8)


def _velocity(axes: Axes, trajectory: Trajectory, t: Array, first: int, label: str) -> None:
    """Draw three components with bands of 3 standard deviations."""
    twist = trajectory.velocity(t)
    variance = np.diagonal(trajectory.covariance(t), axis1=1, axis2=2)
    for k, axis in enumerate(AXES):
        value = twist[:, first + k]
        band = 3 * np.sqrt(variance[:, 6 + first + k])
        axes.plot(t, value, color=COLOURS[k], linewidth=1.0, label=axis)
        axes.fill_between(t, value - band, value + band, color=COLOURS[k], alpha=0.2, linewidth=0)
    spread = np.ptp(twist[:, first : first + 3])
    low, high = twist[:, first : first + 3].min(), twist[:, first : first + 3].max()
    axes.set_ylim(low - 0.3 * spread - 1e-3, high + 0.3 * spread + 1e-3)
    label_axes(axes, "", label)


def _uncertainty(axes: Axes, trajectory: Trajectory, t: Array) -> None:
    deviation = np.sqrt(np.diagonal(trajectory.covariance(t), axis1=1, axis2=2))
    for k, axis in enumerate(AXES):
        axes.plot(t, 1e3 * deviation[:, 3 + k], color=COLOURS[k], linewidth=1.0, label=axis)
    axes.set_ylim(bottom=0)
    label_axes(axes, "", "sigma of position [mm]")


def _errors(axes: Axes, evaluation: Evaluation, trajectory: Trajectory) -> None:
    """Draw the position's error, and three times what the trajectory says it is."""
    first_ns = int(evaluation.estimate.stamps_ns[0])
    t = (first_ns - trajectory.start_ns) * 1e-9 + evaluation.estimate.seconds
    error = evaluation.global_error.norms["translation"]
    axes.plot(t, 1e3 * error, color=COLOURS[0], linewidth=1.2, label="error")
    inside = np.clip(t, trajectory.start, trajectory.stop)
    variance = np.diagonal(trajectory.covariance(inside), axis1=1, axis2=2)[:, 3:6].sum(axis=1)
    axes.plot(t, 3e3 * np.sqrt(variance), color=COLOURS[1], linewidth=0.8, label="3 sigma")
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left", ncols=2, frameon=False, fontsize=8)
    label_axes(axes, "", "position error [mm]")
