"""Recognise the kind of a calibration file, and find one beside a recording."""

from __future__ import annotations

from pathlib import Path

import h5py

from gpvo.errors import InputError
from gpvo.recordings.calibration.basalt import basalt_rig
from gpvo.recordings.calibration.camera_info import is_camera_info, read_camera_info_pair
from gpvo.recordings.calibration.dsec import dsec_rig
from gpvo.recordings.calibration.fields import load_fields
from gpvo.recordings.calibration.kalibr import kalibr_rig
from gpvo.recordings.calibration.m3ed import read_m3ed
from gpvo.recordings.calibration.rig import StereoRig

KNOWN = (
    "a kalibr camchain, DSEC's cam_to_cam.yaml, a basalt calibration (JSON), a ROS CameraInfo"
    " (YAML) beside that of the other camera, or a file of M3ED"
)

BESIDE = (
    "cam_to_cam.yaml",
    "*calibration/cam_to_cam.yaml",
    "camera-calibration*.json",
    "*camchain*.yaml",
    "*camchain*.yml",
    "left.yaml",
)
"""Names of calibrations that are found in the recording's folder and those above it."""

OWN = ".camchain.yaml"
"""What takes the place of a recording's suffix in the name of its own calibration."""

FOLDERS_ABOVE = 3

Calibration = Path | str | StereoRig | None
"""A file, a rig, or None for the calibration in the recording or beside it."""


class MissingCalibrationError(InputError):
    """No calibration was given, and none or several were found."""


def read_calibration(path: Path | str) -> StereoRig:
    """Read a stereo rig from any of the calibration files that gpvo knows.

    Parameters
    ----------
    path
        A kalibr camchain, DSEC's cam_to_cam.yaml, a basalt JSON, one of a pair of ROS CameraInfo
        YAML files or their folder, or an HDF5 file of M3ED.

    Raises
    ------
    InputError
        If the file cannot be read, or a field is missing or has no sensible value.
    """
    path = Path(path)
    if path.is_dir():
        return read_calibration(_of_folder(path))
    if path.is_file() and h5py.is_hdf5(path):
        return read_m3ed(path)
    fields = load_fields(path)
    if "intrinsics" in fields.values and "extrinsics" in fields.values:
        return dsec_rig(fields)
    if "value0" in fields.values:
        return basalt_rig(fields)
    if is_camera_info(fields):
        return read_camera_info_pair(path)
    return kalibr_rig(fields)


def rig_for(recording: Path, calibration: Calibration, format_name: str) -> StereoRig:
    """Return the rig of the given calibration, or of the recording's own or only one beside it.

    Raises
    ------
    MissingCalibrationError
        If there is none or several.
    InputError
        If it cannot be used.
    """
    if isinstance(calibration, StereoRig):
        return calibration
    if calibration is not None:
        return read_calibration(calibration)
    found = calibrations_beside(recording)
    if len(found) == 1:
        return read_calibration(found[0])
    if found:
        listing = " or ".join(f"--calibration {file}" for file in found)
        raise MissingCalibrationError(
            f"{recording}: several calibrations lie beside it; choose {listing}"
        )
    raise MissingCalibrationError(
        f"{recording}: {format_name} holds no calibration; give one of its cameras with"
        f" --calibration camchain.yaml ({KNOWN})"
    )


def calibrations_beside(recording: Path) -> list[Path]:
    """Return the recording's own calibration, or those in the nearest folder that has any."""
    own = recording.absolute().with_suffix(OWN)
    if recording.is_file() and own.is_file():
        return [own]
    folder = recording.absolute() if recording.is_dir() else recording.absolute().parent
    for place in (folder, *folder.parents[:FOLDERS_ABOVE]):
        found = [file for pattern in BESIDE for file in sorted(place.glob(pattern))]
        if usable := [file for file in found if not _is_of_another(file)]:
            return usable
    return []


def _is_of_another(calibration: Path) -> bool:
    """Return whether a calibration is that of a recording beside it, by its name."""
    name = calibration.name.removesuffix(OWN)
    return name != calibration.name and any(
        file.stem == name and file.suffix not in (".yaml", ".yml") and file.is_file()
        for file in calibration.parent.iterdir()
    )


def _of_folder(folder: Path) -> Path:
    found = [file for pattern in BESIDE for file in sorted(folder.glob(pattern))]
    if len(found) != 1:
        listing = ", ".join(file.name for file in found) or "none"
        raise InputError(
            f"{folder}: is a folder with the calibrations {listing}; name one ({KNOWN})"
        )
    return found[0]
