"""The viewer: an observer that shows every cluster in rerun, or writes it to a file.

Needs the extra `view`, rerun-sdk.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from threading import Event
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from gpvo.errors import InputError
from gpvo.estimator import Estimator
from gpvo.events import ClusterEvents
from gpvo.mapping import LandmarkMap
from gpvo.observer import Step
from gpvo.trajectory import MotionEstimate, StampedPoses, Trajectory
from gpvo.view.event_image import COLOURS, event_signs
from gpvo.view.path_so_far import PathSoFar
from gpvo.view.rerun_layout import AXES, BLUE, GREEN, GREY, ORANGE, TIMELINE, layout
from gpvo.view.tracks import TrackHistory

Array = NDArray[np.float64]

MOST_POINTS = 1000
"""Number of points in which a path is shown at most."""
ELLIPSOIDS = 30
"""Number of ellipsoids that are shown at most."""


class RerunViewer:
    """Shows what the odometry sees and finds; to be given to it as observer.

    Parameters
    ----------
    file
        File (.rrd) to write instead of showing.
    stages
        Seconds spent in each stage so far, which a `CostMeter` counts.

    Raises
    ------
    InputError
        If rerun is not installed, or the file cannot be written.
    """

    def __init__(self, file: Path | None = None, stages: Mapping[str, float] | None = None) -> None:
        self._rr = _rerun()
        self._recording = self._rr.RecordingStream("gpvo")
        self._stages: Mapping[str, float] = {} if stages is None else stages
        self._spent: dict[str, float] | None = None
        self._tracks = TrackHistory()
        self._path = PathSoFar()
        self._spread: list[tuple[Array, Array]] = []
        self._expected: tuple[StampedPoses, int] | None = None
        self._open(file)
        self._describe()

    def __call__(self, step: Step) -> None:
        """Show one more cluster."""
        self._at(step.report.stop)
        self._show_images(step)
        self._show_counts(step)
        self._show_stages()
        estimate = step.estimator.latest()
        if estimate is not None:
            self._show_expected_truth(step.estimator)
            self._show_path(self._path(step.estimator))
            self._show_motion(estimate)
            self._show_landmarks(step)

    def expect_truth(self, truth: StampedPoses, start_ns: int) -> None:
        """Show the true path once there is a first state; t = 0 has the absolute stamp start_ns."""
        self._expected = truth, start_ns

    def show_truth(self, truth: StampedPoses, start_ns: int) -> None:
        """Show the true path from `start_ns` on, in the world of its own first pose there."""
        first = min(int(np.searchsorted(truth.stamps_ns, start_ns)), len(truth) - 1)
        T = np.linalg.inv(truth.T_world_cam[first]) @ truth.T_world_cam[first:]
        points = [_thinned(T[:, :3, 3])]
        strip = self._rr.LineStrips3D(points, colors=[GREY], radii=[-1.0])
        self._recording.log("world/ground_truth", strip, static=True)

    def show_trajectory(self, trajectory: Trajectory, interval: float = 0.05) -> None:
        """Show a whole trajectory, every `interval` seconds and at its end."""
        for t in [*np.arange(trajectory.start, trajectory.stop, interval), trajectory.stop]:
            T, twist = trajectory.pose(t), trajectory.velocity(t)
            covariance = trajectory.covariance(t)
            so_far = trajectory.pose(np.linspace(trajectory.start, t, MOST_POINTS))
            self._at(float(t))
            self._show_path(so_far[:, :3, 3])
            self._show_motion(MotionEstimate(float(t), T, twist, covariance, trajectory.qc))

    def show_map(self, landmarks: LandmarkMap) -> None:
        """Show a map: blue where it is certain, yellow where it is not."""
        points = self._rr.Points3D(landmarks.position, colors=landmarks.colours, radii=[-2.0])
        self._recording.log("world/landmarks", points, static=True)

    def wait(self) -> None:
        """Serve the browser until Ctrl-C, if this program serves it."""
        if self._serves:
            print("the viewer is served until Ctrl-C", file=sys.stderr)
            with suppress(KeyboardInterrupt):
                Event().wait()

    def close(self) -> None:
        """Write what is left."""
        self._recording.flush()
        self._recording.disconnect()

    def _open(self, file: Path | None) -> None:
        blueprint = layout()
        self._serves = file is None and not has_display()
        if file is not None:
            try:
                file.parent.mkdir(parents=True, exist_ok=True)
                self._recording.save(file, default_blueprint=blueprint)
            except (OSError, RuntimeError) as error:
                raise InputError(f"{file}: cannot be written ({error})") from error
        elif not self._serves:
            self._recording.spawn(default_blueprint=blueprint)
        else:
            url = self._recording.serve_grpc(default_blueprint=blueprint)
            self._rr.serve_web_viewer(open_browser=False, connect_to=url)
            print(f"viewer: http://localhost:9090/?url={quote(url, safe='')}", file=sys.stderr)

    def _describe(self) -> None:
        """Log what does not change: axes of the world, and how curves are drawn."""
        rr, log = self._rr, self._recording.log
        log("world", rr.ViewCoordinates.RDF, static=True)
        for name in ("linear_velocity", "angular_velocity"):
            for axis, colour in zip(AXES, (BLUE, ORANGE, GREEN), strict=True):
                log(f"{name}/{axis}", rr.SeriesLines(colors=[colour], names=[axis]), static=True)
                names = [f"{axis} - 3 sigma", f"{axis} + 3 sigma"]
                faint = [(*colour, 90)] * 2
                band = rr.SeriesLines(colors=faint, widths=[0.7] * 2, names=names)
                log(f"{name}/{axis}_band", band, static=True)
        for name, colour in (("tracklets", GREY), ("inliers", GREEN)):
            log(f"tracklets/{name}", rr.SeriesLines(colors=[colour], names=[name]), static=True)

    def _at(self, t: float) -> None:
        self._recording.set_time(TIMELINE, duration=t)

    def _show_images(self, step: Step) -> None:
        rr, tracks = self._rr, self._tracks.add(step.tracked)
        colours = tracks.colours
        for side in ("left", "right"):
            lines = getattr(tracks, side)
            self._recording.log(f"{side}/events", self._picture(getattr(step.cluster, side)))
            self._recording.log(f"{side}/tracks", rr.LineStrips2D(lines, colors=colours))
            heads = rr.Points2D(lines[:, -1], colors=colours, radii=[1.2])
            self._recording.log(f"{side}/heads", heads)

    def _picture(self, events: ClusterEvents) -> Any:
        """Return an event image as a PNG with a palette, which is small and quickly packed."""
        image, png = Image.fromarray(event_signs(events)), BytesIO()
        image.putpalette(COLOURS.tobytes())
        image.save(png, "PNG", compress_level=1)
        return self._rr.EncodedImage(contents=png.getvalue(), media_type="image/png")

    def _show_counts(self, step: Step) -> None:
        for name in ("tracklets", "inliers"):
            count = float(getattr(step.report, name))
            self._recording.log(f"tracklets/{name}", self._rr.Scalars([count]))

    def _show_stages(self) -> None:
        before, self._spent = self._spent, dict(self._stages)
        if before is None:  # the first cluster's may be spent on compiling
            return
        for name, seconds in self._spent.items():
            spent = 1e3 * (seconds - before.get(name, 0.0))
            self._recording.log(f"stages/{name.replace(' ', '_')}", self._rr.Scalars([spent]))

    def _show_expected_truth(self, estimator: Estimator) -> None:
        """Show the truth in the world of the estimate, which begins at its first state."""
        if self._expected is None:
            return
        (truth, start_ns), self._expected = self._expected, None
        first = min([*estimator.final_states().t[:1], *estimator.states.t[:1]])
        self.show_truth(truth, start_ns + round(1e9 * first))

    def _show_path(self, positions: Array) -> None:
        path = self._rr.LineStrips3D([_thinned(positions)], colors=[BLUE], radii=[-1.5])
        self._recording.log("world/path", path)

    def _show_motion(self, estimate: MotionEstimate) -> None:
        rr, log, T = self._rr, self._recording.log, estimate.T_world_cam
        sigma = T[:3, :3] @ estimate.covariance[3:6, 3:6] @ T[:3, :3].T
        self._spread.append((T[:3, 3], sigma))
        log("world/camera", rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]))
        axes = rr.Arrows3D(vectors=0.1 * np.eye(3), colors=[ORANGE, GREEN, BLUE])
        log("world/camera/axes", axes)
        log("world/uncertainty", self._ellipsoids())
        deviations = np.sqrt(np.diag(estimate.covariance))
        for name, first in (("linear_velocity", 3), ("angular_velocity", 0)):
            for axis, k in zip(AXES, range(first, first + 3), strict=True):
                value, band = estimate.twist[k], 3 * deviations[6 + k]
                log(f"{name}/{axis}", rr.Scalars([value]))
                log(f"{name}/{axis}_band", rr.Scalars([value - band, value + band]))

    def _ellipsoids(self) -> Any:
        """Return ellipsoids of 3 standard deviations of the position along the path."""
        chosen = self._spread[:: -(-len(self._spread) // ELLIPSOIDS)]
        values, vectors = np.linalg.eigh(np.array([sigma for _, sigma in chosen]))
        vectors *= np.sign(np.linalg.det(vectors))[:, None, None]
        return self._rr.Ellipsoids3D(
            centers=[centre for centre, _ in chosen],
            half_sizes=3 * np.sqrt(np.clip(values, 0, None)),
            quaternions=Rotation.from_matrix(vectors).as_quat(),
            colors=[(*ORANGE, 120)],
        )

    def _show_landmarks(self, step: Step) -> None:
        landmarks = getattr(step.estimator, "landmarks", None)
        if landmarks is not None:
            points = self._rr.Points3D(landmarks[1], colors=[GREEN], radii=[-2.0])
            self._recording.log("world/landmarks", points)


def has_display() -> bool:
    """Return whether windows can be shown."""
    return sys.platform != "linux" or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )


def _thinned(points: Array) -> Array:
    """Return at most `MOST_POINTS` or so of the points (N, 3), always the last."""
    step = -(-len(points) // MOST_POINTS)
    return np.concatenate([points[::step], points[-1:]])


def _rerun() -> Any:
    try:
        import rerun
    except ImportError as error:
        raise InputError("the viewer: pip install 'gpvo[view]'") from error
    return rerun
