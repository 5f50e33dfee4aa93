"""What a run was made from, `run.json`: enough to make it again."""

from __future__ import annotations

import hashlib
import json
import sys
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gpvo.config import Configuration
from gpvo.errors import InputError
from gpvo.evaluation.report.machine import machine
from gpvo.recordings.calibration.find import calibrations_beside
from gpvo.trajectory.whole_file import whole_file

FILE = "run.json"
HEAD = 1 << 20
"""Bytes at the beginning of a file that its hash is of."""


@dataclass(frozen=True)
class Request:
    """What a user asked `gpvo run` for; paths are absolute, times in seconds."""

    recording: str
    calibration: str | None
    ground_truth: str | None
    start: float
    duration: float | None
    left_topic: str | None
    right_topic: str | None
    right_offset: str

    @property
    def files(self) -> dict[str, Path]:
        """The files that are read, by their role."""
        names = ("recording", "calibration", "ground_truth")
        return {name: Path(path) for name in names if (path := getattr(self, name)) is not None}


def absolute(path: Path | None) -> str | None:
    """Return a path that is the same from everywhere."""
    return None if path is None else str(path.absolute())


def calibration_of(recording: Path, given: Path | None) -> Path | None:
    """Return the calibration's file: the given one, or the only one beside the recording."""
    beside = [] if given else calibrations_beside(recording)
    return beside[0] if len(beside) == 1 else given


def write_provenance(folder: Path, request: Request, configuration: Configuration) -> None:
    """Write what a run is made from into its folder."""
    facts = {
        "command": sys.argv,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "request": asdict(request),
        "files": {name: identity(path) for name, path in request.files.items()},
        "configuration": configuration.model_dump(mode="json"),
        "machine": machine(),
    }
    with whole_file(folder / FILE) as file:
        file.write((json.dumps(facts, indent=2) + "\n").encode())


def read_provenance(folder: Path) -> tuple[Request, Configuration]:
    """Read what a run was made from, to make it again.

    Raises
    ------
    InputError
        If there is none, or a file is no longer the one that it was made from.
    """
    path = folder / FILE
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        request = Request(**facts["request"])
        configuration = Configuration.model_validate(facts["configuration"])
        known = {name: facts["files"][name] for name in request.files}
    except (OSError, ValueError, KeyError, TypeError, ValidationError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: is not what `gpvo run` wrote ({reason})") from error
    for name, file in request.files.items():
        if not file.exists():
            raise InputError(f"{path}: the {name} {file} is gone; put it back")
        if identity(file) != known[name]:
            raise InputError(f"{path}: the {name} {file} is not the one of that run; put it back")
    return request, configuration


def identity(path: Path) -> dict[str, Any]:
    """Return the size of a file, or of those in a folder, bytes, and a hash of their heads."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    heads, size = hashlib.sha256(), 0
    for file in files:
        if file.is_file():
            size += file.stat().st_size
            with file.open("rb") as content:
                heads.update(content.read(HEAD))
    return {"bytes": size, "sha256_of_first_mib": heads.hexdigest()}
