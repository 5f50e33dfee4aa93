"""What watches a run: the viewer, if it is wanted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from gpvo.observer import Observer, no_observer
from gpvo.trajectory import StampedPoses

View = Annotated[bool, typer.Option("--view", help="Show it in the viewer (extra view).")]
Save = Annotated[
    Path | None, typer.Option(help="File .rrd for the viewer, written instead of showing it.")
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
    """

    view: bool = False
    save: Path | None = None

    @contextmanager
    def observer(
        self,
        stages: Mapping[str, float],
        truth: StampedPoses | None = None,
        start_ns: int = 0,
    ) -> Iterator[Observer]:
        """Give the observer; it is finished at the end.

        Parameters
        ----------
        stages
            Seconds spent in each stage so far.
        truth, start_ns
            The true poses, if they are known, and the absolute stamp of t = 0.

        Raises
        ------
        InputError
            If the viewer is not installed, or its file cannot be written.
        """
        if not (self.view or self.save):
            yield no_observer
            return
        from gpvo.view.rerun_viewer import RerunViewer  # slow to import

        viewer = RerunViewer(self.save, stages)
        if truth is not None:
            viewer.show_truth(truth, start_ns)
        try:
            yield viewer
        finally:
            viewer.close()
