"""The TUM trajectory format: ``t tx ty tz qx qy qz qw``, seconds and metres, one pose a line."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gpvo.errors import InputError
from gpvo.trajectory.stamped_poses import StampedPoses, quaternions, rigid_transforms, seconds_text
from gpvo.trajectory.whole_file import whole_file

QUATERNION_NORM_TOLERANCE = 1e-2
"""Largest deviation of a norm from 1; files with two decimals pass."""


def tum_lines(poses: StampedPoses) -> list[str]:
    """Format poses as lines of a TUM file; stamps are exact, numbers have nine decimals."""
    values = np.hstack([poses.positions, quaternions(poses.rotations)])
    tidy = np.round(values, 9) + 0.0  # no "-0.000000000"
    return [
        " ".join([seconds_text(stamp), *(f"{value:.9f}" for value in row)]) + "\n"
        for stamp, row in zip(poses.stamps_ns.tolist(), tidy.tolist(), strict=True)
    ]


def write_tum(path: Path | str, poses: StampedPoses) -> None:
    """Write poses as a TUM file; an existing file is replaced by the complete one."""
    with whole_file(path) as file:
        file.write("".join(tum_lines(poses)).encode("ascii"))


def read_tum(path: Path | str) -> StampedPoses:
    """Read a TUM file; comments (#), empty lines and commas between the numbers are allowed.

    Raises
    ------
    InputError
        If the file or a line cannot be used; the message names it.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a text file ({error})") from error
    return parse_tum(text.splitlines(), str(path))


def parse_tum(lines: Iterable[str], name: str, unit_ns: int = 10**9) -> StampedPoses:
    """Parse the lines of a TUM file; `name` is the file in error messages.

    `unit_ns` is the unit of the stamps, nanoseconds.
    """
    stamps: list[int] = []
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        if fields := text_fields(line):
            stamp, row = _parse_fields(fields, f"{name}:{number}", unit_ns)
            if stamps and stamp <= stamps[-1]:
                raise InputError(
                    f"{name}:{number}: the stamp {fields[0]} does not come after the one before;"
                    " sort the file by time and remove repeated lines"
                )
            stamps.append(stamp)
            rows.append(row)
    if not rows:
        raise InputError(f"{name}: holds no pose; expected lines 't tx ty tz qx qy qz qw'")
    values = np.array(rows)
    rotations = Rotation.from_quat(values[:, 3:]).as_matrix()
    return StampedPoses(np.array(stamps, np.int64), rigid_transforms(rotations, values[:, :3]))


def text_fields(line: str) -> list[str]:
    """Return the numbers of a line, between spaces or commas, without a comment."""
    return line.split("#", 1)[0].replace(",", " ").split()


def _parse_fields(fields: list[str], place: str, unit_ns: int) -> tuple[int, list[float]]:
    if len(fields) != 8:
        raise InputError(f"{place}: has {len(fields)} numbers where 't tx ty tz qx qy qz qw' has 8")
    try:
        stamp, row = nanoseconds(fields[0], unit_ns), [float(field) for field in fields[1:]]
    except (ValueError, ArithmeticError) as error:
        raise InputError(f"{place}: is not eight numbers, the first a time") from error
    if not np.isfinite(row).all():
        raise InputError(f"{place}: holds a number that is not finite")
    norm = float(np.linalg.norm(row[3:]))
    if abs(norm - 1.0) > QUATERNION_NORM_TOLERANCE:
        raise InputError(f"{place}: the quaternion has norm {norm:.4g}, not 1")
    return stamp, row


def nanoseconds(stamp: str, unit_ns: int = 10**9) -> int:
    """Convert a decimal stamp to the nearest nanosecond, without the rounding of a float.

    Raises
    ------
    ValueError, ArithmeticError
        If it is no number, or none since the epoch.
    """
    exact = Decimal(stamp) * unit_ns
    if not abs(exact) < 2**63:
        raise ValueError("not a time since the epoch")
    return int(exact.to_integral_value())
