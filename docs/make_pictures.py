"""Make all pictures of the documentation from runs: `python -m docs.make_pictures [NAME ...]`."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

PICTURES = Path(__file__).parent / "pictures"
RESULTS = ("path", "error", "tracklets")
"""Plots of the demo's results."""
EXAMPLES = (
    "asynchronous_tracklets",
    "fixed_lag_smoother",
    "gps_between_states",
    "imu_and_events",
    "lidar_points",
    "mc_ransac",
    "planar_robot",
)
"""Examples that take the name of a picture."""


def demo() -> None:
    """Run `gpvo demo` and keep its plots."""
    with tempfile.TemporaryDirectory() as folder:
        _python("-c", "from gpvo.commands.cli import main; main()", "demo", "--output", folder)
        for name in RESULTS:
            shutil.copy(Path(folder, f"{name}.png"), PICTURES / f"demo_{name}.png")


def consistency() -> None:
    """Compare true errors with covariances over many simulated runs."""
    _python("-m", "benchmarks.consistency", "--runs", "60", "--output", _picture("consistency"))


def _python(*arguments: str) -> None:
    subprocess.run([sys.executable, *arguments], check=True)


def _picture(name: str) -> str:
    return str(PICTURES / f"{name}.png")


def main(names: Sequence[str]) -> None:
    """Make the pictures of some runs, by default of all."""
    for name in names or ("demo", "consistency", *EXAMPLES):
        if name in EXAMPLES:
            _python("-m", f"examples.{name}", _picture(name))
        else:
            {"demo": demo, "consistency": consistency}[name]()


if __name__ == "__main__":
    main(sys.argv[1:])
