"""What all tests share, and the order of their files."""

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest

# Also where bytecode is not to be kept: each process that a test starts would compile a second.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# A console keeps the width that COLUMNS has when it is made; a test's own is to count.
os.environ.pop("COLUMNS", None)
import gpvo.commands.inputs  # noqa: F401

FIRST = (
    "documentation/test_readme.py",
    "factors/test_example.py",
    "estimator/test_long_tracks.py",
    "estimator/test_dead_reckoning.py",
    "estimator/test_learned_noise.py",
    "estimator/test_robustness.py",
    "estimator/test_loops.py",
    "command_line/test_many.py",
    "command_line/test_kill.py",
    "documentation/test_pages.py",
    "command_line/test_live.py",
    "command_line/test_run.py",
    "live/test_live_odometry.py",
    "live/test_little_time.py",
    "front_end/test_cold_kernels.py",
    "benchmarks/test_faults.py",
    "recordings/test_damage.py",
)
"""Files that take long, so that none is left at the end.

The examples of the factors compile what other files would compile once more at the same time.
"""
COMPILE = """
import gc
from gpvo import Configuration
from gpvo.warm_up.whole import warm_up

gc.disable()
warm_up(Configuration())
"""
"""The compiler keeps what it makes: looking for garbage in it took a tenth of the time."""


def pytest_configure(config: pytest.Config) -> None:
    config.option.loadscopereorder = False  # xdist would begin with files of many tests


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile before xdist's processes begin, in two: each of them would compile nearly all."""
    if getattr(session.config.option, "numprocesses", None):
        subprocess.run([sys.executable, "-c", COMPILE], check=True)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    place = {Path(__file__).parent / name: number for number, name in enumerate(FIRST)}
    items.sort(key=lambda item: place.get(item.path, len(place)))


def pytest_collection_finish() -> None:
    """Leave out of garbage collection what is there to stay: it took a tenth of the time."""
    gc.collect()
    gc.freeze()
