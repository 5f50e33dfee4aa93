"""Paths of the files that `gpvo run` reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class RecordingFiles:
    """Paths of a recording, its calibration and its ground truth."""

    data: Path
    calibration: Path
    ground_truth: Path
    config: Path

    def arguments(self, output: Path) -> list[str]:
        """Return the arguments of `gpvo run`."""
        files = ["--calibration", self.calibration, "--ground-truth", self.ground_truth]
        return ["run", *map(str, [self.data, *files, "--config", self.config, "--output", output])]
