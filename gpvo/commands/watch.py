"""What watches a run: the viewer and the video, if they are wanted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from gpvo.observer import Observer, observers
from gpvo.trajectory import StampedPoses

View = Annotated[bool, typer.Option("--view", help="Show it in the viewer (extra view).")]
Save = Annotated[
    Path | None, typer.Option(help="File .rrd for the viewer, written instead of showing it.")
]
Video = Annotated[
    Path | None, typer.Option(help="File .mp4 of the event images with tracks, and the path.")
]


@dataclass(frozen=True)
class Watch:
    """What the user wants to watch a run with.

    Attributes
    ----------
    view
        The viewer in a window, or in a browser.
    save
        The viewer's file.
    video
        The video's file.
    """

    view: bool = False
    save: Path | None = None
    video: Path | None = None

    @contextmanager
    def observer(
        self,
        stages: Mapping[str, float],
        truth: StampedPoses | None = None,
        start_ns: int = 0,
    ) -> Iterator[Observer]:
        """Give an observer that serves all of them; they are finished at the end.

        Parameters
        ----------
        stages
            Seconds spent in each stage so far.
        truth, start_ns
            The true poses, if they are known, and the absolute stamp of t = 0.

        Raises
        ------
        InputError
            If the viewer is not installed, or a file cannot be written.
        """
        watching: list[Observer] = []
        with ExitStack() as opened:
            if self.view or self.save:
                from gpvo.view.rerun_viewer import RerunViewer  # slow to import

                viewer = RerunViewer(self.save, stages)
                opened.callback(viewer.close)
                if truth is not None:
                    viewer.expect_truth(truth, start_ns)
                watching.append(viewer)
            if self.video:
                from gpvo.view.video import VideoWriter

                video = VideoWriter(self.video)
                opened.callback(video.close)
                watching.append(video)
            yield observers(*watching)
