"""Poses from files: result folders, TUM and KITTI text, MVSEC ground truth, ROS pose bags."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from gpvo.errors import InputError
from gpvo.evaluation.poses.body_frames import body_to_left, raw_to_rectified
from gpvo.evaluation.poses.continuous import ContinuousPoses
from gpvo.evaluation.poses.rosbag import read_pose_bag
from gpvo.recordings import StereoRig
from gpvo.recordings.bags.rosbag1 import RosBag1
from gpvo.recordings.checks.time_unit import unit_since_1970
from gpvo.trajectory import StampedPoses, Trajectory
from gpvo.trajectory.stamped_poses import rigid_transforms
from gpvo.trajectory.tum import nanoseconds, parse_tum, text_fields

KITTI_FRAME_NS = 100_000_000
"""Frame interval of KITTI's cameras (10 Hz), used if the poses have no times.txt beside them."""

MVSEC_TOPIC = "/davis/left/pose"
"""The pose topic to read from MVSEC's ground truth bags, which hold several."""

LARGEST_STEP = 100.0
"""Largest plausible step between poses, seconds; larger steps are microseconds."""

LARGEST_MICROSECONDS = 3_000_000
"""Largest plausible step in microseconds; larger steps are nanoseconds."""

FINER_NS = {"milliseconds": 10**6, "nanoseconds": 1}
"""Units that stamps since 1970 tell, and steps alone do not."""

SCALAR_FIRST = re.compile(r"\bq\w*w\b.*\bq\w*x\b")
"""Heading of EuRoC and others, with qw before qx."""

LONGEST_HEADING = 2
"""Largest number of heading lines."""

TRAJECTORY_NAMES = ("trajectory.npz", "trajectory.tum", "stamped_traj_estimate.txt")
"""Names of the estimate in folders of `gpvo run` and rpg_trajectory_evaluation, best first."""


def load_poses(
    path: Path | str, rig: StereoRig | None = None, beside: Sequence[Path] = ()
) -> StampedPoses:
    """Read poses in the format that the file's contents show.

    Parameters
    ----------
    path
        A TUM or KITTI text file, an MVSEC ground truth (HDF5), a ROS 1 or 2 bag with one pose topic
        (several: append ":/topic" to the name), a continuous trajectory that `gpvo run` saved
        (.npz), or a folder with one of TRAJECTORY_NAMES in it.
    rig
        Calibration; needed for MVSEC, whose poses are those of the raw left camera, and for
        TUM-VIE and VECtor, whose poses are those of a body.
    beside
        Paths to search before the folder of the poses for the extrinsics between a body and the
        camera: a calibration file, the recording.

    Returns
    -------
    StampedPoses
        T_world_cam as in the file. For MVSEC, and for DSEC, TUM-VIE and VECtor if their extrinsics
        are found, it is that of the rectified left camera. A continuous trajectory gives
        `ContinuousPoses`.

    Raises
    ------
    InputError
        If there is no such file or its contents cannot be used.
    """
    file, topic = split_topic(Path(path))
    if file.is_dir() and not (file / "metadata.yaml").exists():
        file = find_trajectory(file)
    if file.suffix == ".npz":
        return ContinuousPoses.of(Trajectory.load(file))
    if h5py.is_hdf5(file):
        return read_mvsec_poses(file, rig)
    if not (file.is_dir() or file.suffix in (".bag", ".db3", ".mcap")):
        return _of_left_camera(read_text_poses(file), file, rig, beside)
    if topic is None and file.name.endswith("_gt.bag") and MVSEC_TOPIC in _topics(file):
        return _rectified(read_pose_bag(file, MVSEC_TOPIC), rig, file)
    return _of_left_camera(read_pose_bag(file, topic), file, rig, beside)


def _topics(file: Path) -> Collection[str]:
    """Return the topics of a ROS 1 bag; none for other files."""
    return RosBag1(file).topics if RosBag1.recognise(file) else ()


def _of_left_camera(
    poses: StampedPoses, file: Path, rig: StereoRig | None, beside: Sequence[Path]
) -> StampedPoses:
    """Return poses of the left camera, given those of the body that a data set tracks."""
    T_body_left = body_to_left(file, rig, beside)
    return poses if T_body_left is None else poses.seen_from(T_body_left)


def _rectified(poses: StampedPoses, rig: StereoRig | None, path: Path) -> StampedPoses:
    """Return poses of the rectified left camera, given those of the raw one."""
    if rig is None:
        raise InputError(
            f"{path}: holds poses of the raw left camera; give the calibration (--calibration)"
            " that rectifies it"
        )
    return poses.seen_from(raw_to_rectified(rig))


def split_topic(path: Path) -> tuple[Path, str | None]:
    """Split "FILE:/topic" into file and topic; InputError if there is no such file."""
    if path.exists():
        return path, None
    name, separator, topic = str(path).rpartition(":/")
    if not (separator and Path(name).exists()):
        raise InputError(f"{path}: no such file or folder")
    return Path(name), "/" + topic


def find_trajectory(folder: Path) -> Path:
    """Return the estimate in a result folder; InputError if there is none."""
    for name in TRAJECTORY_NAMES:
        if (folder / name).exists():
            return folder / name
    raise InputError(f"{folder}: holds none of {', '.join(TRAJECTORY_NAMES)}")


def read_text_poses(path: Path) -> StampedPoses:
    """Read a TUM (8 numbers a line) or KITTI (12 numbers a line) file.

    Lines that name the columns are skipped, but if they name qw before qx, it comes first. Stamps
    may be microseconds, as TUM-VIE's are, or nanoseconds.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not a text file of poses") from error
    if any(SCALAR_FIRST.search(line) for line in lines[:LONGEST_HEADING]):
        lines = [_scalar_last(line) for line in lines]
    lines = _without_heading(lines)
    rows = [fields for line in lines if (fields := text_fields(line))]
    if rows and len(rows[0]) == 12:
        return _read_kitti(path, rows)
    return parse_tum(lines, str(path), _unit_ns(rows))


def _scalar_last(line: str) -> str:
    """Return a line of t tx ty tz qw qx qy qz in the order of TUM."""
    fields = text_fields(line)
    return " ".join([*fields[:4], *fields[5:], fields[4]]) if len(fields) == 8 else line


def _without_heading(lines: list[str]) -> list[str]:
    """Comment out lines of words before the numbers, like those of TUM-VIE and VECtor."""
    for number, line in enumerate(lines[:LONGEST_HEADING]):
        if re.match(r"\s*[-+.\d]", line):
            break
        lines[number] = "# " + line
    return lines


def _unit_ns(rows: list[list[str]]) -> int:
    """Return the nanoseconds in the unit of stamps, by their size or the steps between them."""
    try:
        stamps = [float(row[0]) for row in rows[:100]]
    except ValueError:
        return 10**9
    if len(stamps) < 2:
        return 10**9
    step = float(np.median(np.diff(stamps)))
    finer = FINER_NS.get(unit_since_1970(float(np.median(stamps))) or "")
    if finer is not None and step * finer < LARGEST_STEP * 1e9:
        return finer
    if step > LARGEST_MICROSECONDS:
        return 1
    return 1000 if step > LARGEST_STEP else 10**9


def _read_kitti(path: Path, rows: list[list[str]]) -> StampedPoses:
    try:
        poses = np.array(rows, np.float64).reshape(-1, 3, 4)
    except ValueError as error:
        raise InputError(f"{path}: is not a KITTI file, 12 numbers on every line") from error
    T_world_cam = rigid_transforms(poses[:, :, :3], poses[:, :, 3])
    return StampedPoses.read_from(str(path), _kitti_stamps(path, len(poses)), T_world_cam)


def _kitti_stamps(path: Path, count: int) -> NDArray[np.int64]:
    """Return the stamps of times.txt beside the poses (seconds a line), or frames at 10 Hz."""
    times = path.with_name("times.txt")
    if not times.exists():
        return np.arange(count, dtype=np.int64) * KITTI_FRAME_NS
    stamps_ns = _listed_stamps(times)
    if len(stamps_ns) != count:
        raise InputError(f"{times}: has {len(stamps_ns)} times for the {count} poses of {path}")
    if (np.diff(stamps_ns) <= 0).any():
        raise InputError(f"{times}: the times do not increase; give each pose its own")
    return stamps_ns


def _listed_stamps(times: Path) -> NDArray[np.int64]:
    """Return the stamps of a file with seconds, one number a line, nanoseconds."""
    try:
        lines = times.read_text(encoding="utf-8-sig").splitlines()
        rows = [fields for line in lines if (fields := text_fields(line))]
        return np.array([nanoseconds(" ".join(fields)) for fields in rows], np.int64)
    except (OSError, ValueError, ArithmeticError) as error:
        raise InputError(f"{times}: is not a list of times in seconds, one a line") from error


def read_mvsec_poses(path: Path, rig: StereoRig | None) -> StampedPoses:
    """Read T_world_cam of the rectified left camera from davis/left/pose of an MVSEC file."""
    try:
        with h5py.File(path) as file:
            T_world_raw = file["davis/left/pose"][:].astype(np.float64)
            seconds = file["davis/left/pose_ts"][:].astype(np.float64)
    except (KeyError, OSError) as error:
        raise InputError(f"{path}: holds no readable davis/left/pose and pose_ts") from error
    if not np.isfinite(seconds).all():
        raise InputError(f"{path}: davis/left/pose_ts holds numbers that are not finite")
    stamps_ns = np.round(seconds * 1e9).astype(np.int64)
    poses = StampedPoses.read_from(f"{path}: davis/left/pose", stamps_ns, T_world_raw)
    return _rectified(poses, rig, path)
