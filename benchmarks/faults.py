"""Faults put into simulated recordings: what becomes of the estimate, and what is said of it.

python -m benchmarks.faults [--faults NAME ...] [--seeds N] [--duration SECONDS] [--output DIR]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.dataset import exit_with
from benchmarks.fault_cases import FAULTS, Fault
from benchmarks.options import at_least_one, positive
from factors.lie import se3_inverse, se3_log
from gpvo.errors import InputError
from gpvo.evaluation import evaluate
from gpvo.evaluation.poses.continuous import ContinuousPoses
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.odometry import Odometry
from gpvo.simulation import SimulatedRecording, SimulationConfig, simulate
from gpvo.trajectory import StampedPoses, Trajectory

CAMERAS = {
    "240 x 180": SimulationConfig(resolution=(240, 180), focal_length=160.0, noise_rate=0.1),
    "346 x 260": SimulationConfig(noise_rate=0.1),
}
FIRST_SEED = 3
BEGIN = 0.4
"""Share of the recording after which a fault begins."""
HARMLESS = 1.3
"""Largest ratio of the final error to the unharmed one's, where a fault does no harm."""
SCATTER = 1.0
"""Final errors in percent below which ratios say nothing."""


@dataclass(frozen=True)
class FaultResult:
    """What became of one recording with one fault.

    Attributes
    ----------
    final_percent, relative
        Final error in percent of the path, RMS of the relative SE(3) error; NaN if refused.
    nees
        NEES of the last pose; 6 on average if consistent.
    verdict
        Word of the verdict, or refused.
    said
        Kinds of faults that were said, and the refusal.
    """

    camera: str
    seed: int
    fault: str
    final_percent: float
    relative: float
    nees: float
    verdict: str
    said: tuple[str, ...]

    def is_right(self, fault: Fault) -> bool:
        """Return whether the verdict is right and the fault is named."""
        refused = self.verdict == "refused" and "failed" in fault.verdicts
        named = not fault.said or any(fault.said in one for one in self.said)
        return (self.verdict in fault.verdicts or refused) and named


def run_fault(camera: str, seed: int, fault: Fault, sound: SimulatedRecording) -> FaultResult:
    """Estimate the motion of a recording with one fault."""
    harmed = fault.harm(sound, BEGIN * sound.duration, np.random.default_rng(seed))
    odometry = Odometry(harmed.rig)
    try:
        trajectory = odometry.run(harmed)
    except InputError as error:
        said = (*(one.text for one in odometry.faults), str(error))
        return FaultResult(camera, seed, fault.name, np.nan, np.nan, np.nan, "refused", said)
    truth = harmed.ground_truth
    evaluation = evaluate(ContinuousPoses.of(trajectory), truth, step=0.01)
    return FaultResult(
        camera,
        seed,
        fault.name,
        evaluation.global_error.statistics("translation").final_percent,
        evaluation.relative_error.statistics("se3").rms,
        last_nees(trajectory, truth),
        odometry.verdict().word,
        tuple(f"{one.kind}: {one.text}" for one in odometry.faults),
    )


def last_nees(trajectory: Trajectory, truth: StampedPoses) -> float:
    """Compute the NEES of the last pose that the ground truth covers."""
    stamps = trajectory.stamps_ns(np.array([trajectory.start, trajectory.stop]))
    stamps = np.clip(stamps, truth.stamps_ns[0], truth.stamps_ns[-1])
    T_first, T_last = truth.interpolate(stamps).T_world_cam
    t = np.array([(stamps[1] - trajectory.start_ns) / 1e9]).clip(max=trajectory.stop)  # rounded
    error = se3_log(se3_inverse(trajectory.pose(t)[0]) @ se3_inverse(T_first) @ T_last)
    covariance = trajectory.covariance(t)[0, :6, :6]
    return float(error @ np.linalg.solve(covariance, error))


def run_all(faults: Sequence[Fault], seeds: int, duration: float) -> Iterator[FaultResult]:
    """Run every fault with every camera and seed."""
    for camera, config in CAMERAS.items():
        for seed in range(FIRST_SEED, FIRST_SEED + seeds):
            sound = simulate(config.model_copy(update={"seed": seed, "duration": duration}))
            for fault in faults:
                yield run_fault(camera, seed, fault, sound)


def table(results: Sequence[FaultResult], faults: Sequence[Fault]) -> str:
    """Format the results as a Markdown table, one row for each fault."""
    head = [f"{camera}, seed {seed}" for camera, seed in _runs(results)]
    lines = ["| fault | " + " | ".join(head) + " | right |", "|---" * (len(head) + 2) + "|"]
    sound = {(one.camera, one.seed): one for one in results if one.fault == "unharmed"}
    for fault in faults:
        row = [one for one in results if one.fault == fault.name]
        right = sum(one.is_right(fault) for one in row)
        cells = [_cell(one, fault, sound.get((one.camera, one.seed))) for one in row]
        lines.append(f"| {fault.name} | " + " | ".join(cells) + f" | {right} of {len(row)} |")
    return "\n".join(lines) + "\n"


def _runs(results: Sequence[FaultResult]) -> list[tuple[str, int]]:
    return list(dict.fromkeys((one.camera, one.seed) for one in results))


def _cell(one: FaultResult, fault: Fault, sound: FaultResult | None) -> str:
    """Format the errors, NEES and verdict; mark harm where there should be none."""
    if one.verdict == "refused":
        return "refused"
    harmed = sound is not None and one.final_percent > max(
        HARMLESS * sound.final_percent, sound.final_percent + SCATTER
    )
    mark = " (!)" if fault.harmless and harmed else ""
    numbers = f"{one.final_percent:.1f}{mark} / {1000 * one.relative:.2f}e-3"
    return f"{numbers}, NEES {one.nees:.0f}, {one.verdict}"


def main(arguments: Sequence[str] | None = None) -> list[FaultResult]:
    """Parse the options, run, print and write the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--faults", nargs="+", metavar="NAME", help="some of them")
    parser.add_argument("--seeds", type=at_least_one, default=2)
    parser.add_argument("--duration", type=positive, default=5.0, help="seconds")
    parser.add_argument("--output", type=Path, help="folder for faults.json and faults.md")
    options = parser.parse_args(arguments)
    known = {fault.name: fault for fault in FAULTS}
    for name in options.faults or ():
        if name not in known:
            raise InputError(f"--faults {name!r}: known are {', '.join(known)}")
    faults = [known[name] for name in options.faults or known]
    results = []
    for result in run_all(faults, options.seeds, options.duration):
        results.append(result)
        print(result.camera, result.seed, result.fault, _cell(result, known[result.fault], None))
    print(table(results, faults), end="")
    if options.output is not None:
        folder = make_folder(options.output)
        (folder / "faults.md").write_text(table(results, faults), encoding="utf-8")
        rows = [asdict(result) for result in results]
        (folder / "faults.json").write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    return results


if __name__ == "__main__":
    exit_with(main)
