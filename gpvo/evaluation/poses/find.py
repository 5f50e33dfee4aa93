"""Search for estimates and their ground truth in files and folders."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gpvo.errors import InputError
from gpvo.evaluation.poses.load import TRAJECTORY_NAMES, load_poses, split_topic
from gpvo.recordings import read_calibration
from gpvo.trajectory import StampedPoses

GROUND_TRUTH_NAMES = ("ground_truth.tum", "stamped_groundtruth.txt")
"""Names of the ground truth in folders of `gpvo run` and rpg_trajectory_evaluation."""


@dataclass(frozen=True)
class Source:
    """Files of one estimate and of its ground truth."""

    name: str
    estimate: Path
    ground_truth: Path

    def load(self, calibration: Path | None = None) -> tuple[StampedPoses, StampedPoses]:
        """Read the poses of the estimate and of the ground truth."""
        rig = read_calibration(calibration) if calibration else None
        beside = [calibration] if calibration else []
        truth = load_poses(self.ground_truth, rig, beside)
        return load_poses(self.estimate, rig, beside), truth


@dataclass(frozen=True)
class SequenceSources:
    """Estimates to compare on one sequence, the estimate of interest first."""

    name: str
    estimates: list[Source] = field(default_factory=list)


def find_sources(
    path: Path, ground_truth: Path | None = None, against: Mapping[str, Path] | None = None
) -> list[SequenceSources]:
    """Find the estimates to evaluate, by sequence.

    Parameters
    ----------
    path
        An estimate (any file of `load_poses`), a result folder with an estimate in it, a folder of
        one sequence (stamped_groundtruth.txt and any number of estimates), or a folder of
        such folders.
    ground_truth
        File of poses. Without it the ground truth is searched beside the estimate: as
        NAME_groundtruth.txt for the estimate NAME.txt, or as one of GROUND_TRUTH_NAMES.
    against
        Competitors by name, compared with the same ground truth.

    Raises
    ------
    InputError
        If there is no such file, no estimate in it, no ground truth for it, or two estimates have
        one name.
    """
    split_topic(path)
    if not path.is_dir() or (path / "metadata.yaml").exists() or _holds_trajectory(path):
        sequence = path.resolve().name if path.is_dir() else path.stem
        return [_sequence(sequence, [path], ground_truth, against or {})]
    estimates = _estimates_in(path)
    if estimates:
        return [_sequence(path.resolve().name, estimates, ground_truth, against or {})]
    folders = sorted(folder for folder in path.iterdir() if _is_sequence(folder))
    if not folders:
        raise InputError(
            f"{path}: holds no estimate; expected one of {', '.join(TRAJECTORY_NAMES)}, or"
            " stamped_groundtruth.txt with estimates (.txt, .tum) beside it"
        )
    if ground_truth or against:
        raise InputError(f"{path}: holds several sequences; name one of them to compare it")
    return [sequence for folder in folders for sequence in find_sources(folder)]


def _holds_trajectory(folder: Path) -> bool:
    return any((folder / name).exists() for name in TRAJECTORY_NAMES)


def _is_sequence(folder: Path) -> bool:
    return folder.is_dir() and (
        _holds_trajectory(folder) or bool(_estimates_in(folder) and _ground_truth_in(folder))
    )


def _estimates_in(folder: Path) -> list[Path]:
    """Return the text trajectories of a sequence's folder that are not ground truth, by name."""
    if _ground_truth_in(folder) is None:
        return []
    files = [*folder.glob("*.txt"), *folder.glob("*.tum")]
    truths = ("groundtruth", "ground_truth")
    return sorted(
        file for file in files if not file.stem.endswith(truths) and file.name != "times.txt"
    )


def _ground_truth_in(folder: Path) -> Path | None:
    present = (folder / name for name in GROUND_TRUTH_NAMES)
    return next((file for file in present if file.exists()), None)


def _sequence(
    name: str, estimates: list[Path], ground_truth: Path | None, against: Mapping[str, Path]
) -> SequenceSources:
    sources = [
        Source(_label(path), path, ground_truth or _ground_truth_of(path)) for path in estimates
    ]
    for label, path in against.items():
        sources.append(Source(label, path, sources[0].ground_truth))
    require_different_names([(source.name, source.estimate) for source in sources])
    return SequenceSources(name, sources)


def require_different_names(named: Iterable[tuple[str, Path]]) -> None:
    """Raise InputError if two estimates have one name: tables and plots go by names."""
    files: dict[str, Path] = {}
    for name, file in named:
        if name in files:
            raise InputError(
                f"{file}: its name, {name}, is that of {files[name]}, too; rename one, or"
                " name the competitor otherwise in --against NAME=FILE"
            )
        files[name] = file


def _label(path: Path) -> str:
    ours = (path / "trajectory.tum").exists() or path.name == "trajectory.npz"
    return "gpvo" if ours else path.stem


def _ground_truth_of(estimate: Path) -> Path:
    folder = estimate if estimate.is_dir() else estimate.parent
    own = folder / f"{estimate.stem}_groundtruth.txt"
    found = own if own.exists() else _ground_truth_in(folder)
    if found is None:
        raise InputError(f"{estimate}: has no ground truth beside it; give --ground-truth FILE")
    return found
