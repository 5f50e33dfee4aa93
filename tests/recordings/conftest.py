"""Small recordings on disk, and the folder of larger ones if it is present."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from recording_files import camchain, event_rows, write_mvsec

SHARED = Path(__file__).resolve().parents[3] / "shared"


@pytest.fixture
def write_camchain(tmp_path: Path) -> Callable[[Any], Path]:
    """Return a function that writes a camchain and returns its path."""

    def write(content: Any) -> Path:
        path = tmp_path / "camchain.yaml"
        path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
        return path

    return write


@pytest.fixture
def calibration(write_camchain: Callable[[Any], Path]) -> Path:
    return write_camchain(camchain())


@pytest.fixture
def recording_path(tmp_path: Path) -> Path:
    return write_mvsec(tmp_path / "data.hdf5", event_rows(900, 1), event_rows(800, 2))


@pytest.fixture(scope="session")
def shared() -> Path:
    """Return the folder of real and simulated recordings, which is not part of the project."""
    if not (SHARED / "recordings").is_dir():
        pytest.skip("the shared folder of recordings is not here")
    return SHARED
