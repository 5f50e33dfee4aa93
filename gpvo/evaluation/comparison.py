"""Several estimates of one sequence against its ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from factors.lie import se3_inverse
from gpvo.evaluation.association import associate, resample, tolerance_for
from gpvo.evaluation.evaluate import Evaluation, Interpolation, evaluate
from gpvo.evaluation.offsets import find_body_offset, find_time_offset
from gpvo.evaluation.paper import FrameTransform
from gpvo.evaluation.tables import (
    ErrorRow,
    ResultTable,
    global_error_table,
    relative_error_table,
    summary_table,
)
from gpvo.poses import StampedPoses

Association = Literal["nearest", "interpolated"]
BodyAlignment = Literal["none", "rotation", "full"]


@dataclass(frozen=True)
class Protocol:
    """How estimates are compared with the ground truth.

    Attributes
    ----------
    step
        Compare every so many seconds. None, as in the paper: at each contender's states, see
        `Contender`.
    truth_between
        How the ground truth is interpolated, see `evaluate`.
    association
        Poses for ATE, RPE and drift: the "nearest" in time, as evo takes them, or the denser
        trajectory "interpolated" at the sparser one's stamps.
    max_difference
        Seconds that the nearest may be away; None: 0.02, or 0.3 intervals of a sparse truth.
    aligned_at
        Frame transform of the relative error, see `relative_error`.
    align_body
        First remove the constant "rotation" (or "full" offset) between the body whose motion was
        estimated and the one of the ground truth.
    align_time
        First remove the constant offset between the clocks.

    Raises
    ------
    InputError
        If `step` is not positive or `max_difference` is negative.
    """

    step: float | None = None
    truth_between: Interpolation = "linear"
    association: Association = "nearest"
    max_difference: float | None = None
    aligned_at: FrameTransform = "step"
    align_body: BodyAlignment = "none"
    align_time: bool = False

    def __post_init__(self) -> None:
        if self.step is not None and not STEP_RESOLUTION <= self.step < np.inf:
            raise InputError(f"--step {self.step:g}: give seconds, at least {STEP_RESOLUTION:g}")
        if self.max_difference is not None and not 0.0 <= self.max_difference < np.inf:
            raise InputError(f"--max-difference {self.max_difference:g}: give seconds, 0 or more")

    def pair(
        self, estimate: StampedPoses, ground_truth: StampedPoses
    ) -> tuple[StampedPoses, StampedPoses]:
        """Poses that belong together."""
        if self.association == "interpolated":
            return resample(estimate, ground_truth)
        return associate(estimate, ground_truth, self.tolerance(ground_truth))

    def tolerance(self, ground_truth: StampedPoses) -> float:
        """Seconds that associated poses may differ."""
        if self.max_difference is None:
            return tolerance_for(ground_truth)
        return self.max_difference

    def describe(self, contenders: Sequence[Contender]) -> str:
        """One sentence to stand below the tables."""
        where = f"every {self.step:g} s" if self.step else _places(contenders)
        between = "by the Gaussian process" if self.truth_between == "gp" else "linearly"
        text = f"Compared {where}, first poses aligned, ground truth interpolated {between}; "
        if self.association == "nearest":
            tolerance = self.tolerance(contenders[0].ground_truth)
            text += f"ATE, RPE, drift: poses within {tolerance:.2g} s"
        else:
            text += "ATE, RPE, drift: interpolated at the sparser trajectory's stamps"
        if self.align_body != "none":
            text += f"; constant body offset removed ({self.align_body})"
        return text + ("; constant clock offset removed." if self.align_time else ".")


@dataclass(frozen=True)
class Contender:
    """An estimate and the ground truth that it is compared with.

    It is compared at its own states, a continuous trajectory every 0.01 s, or at those of another
    contender: the paper takes the competitor's, so that both have the same time between poses.
    """

    name: str
    estimate: StampedPoses
    ground_truth: StampedPoses
    at_states_of: Contender | None = None

    @property
    def place(self) -> str:
        """Where it is compared, in words."""
        if self.at_states_of is not None:
            return f"at the states of {self.at_states_of.name}"
        continuous = isinstance(self.estimate, ContinuousPoses)
        return f"every {STEP:g} s" if continuous else "at its states"


def _places(contenders: Sequence[Contender]) -> str:
    places = {contender.place for contender in contenders}
    if len(contenders) == 1 or len(places) == 1:
        return contenders[0].place.replace("its", "their" if len(contenders) > 1 else "its")
    return ", ".join(f"{contender.name} {contender.place}" for contender in contenders)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Evaluations of one sequence, the estimate of interest first.

    `conditions` is a sentence on how the numbers were made; `time_offsets` are seconds by name.
    """

    sequence: str
    evaluations: list[Evaluation]
    conditions: str
    time_offsets: dict[str, float]

    def tables(self) -> list[ResultTable]:
        """The paper's Tables I and II, and evo's numbers."""
        rows = [ErrorRow.of(evaluation) for evaluation in self.evaluations]
        return [
            global_error_table(rows, self.sequence),
            relative_error_table(rows, self.sequence),
            summary_table(self.evaluations, self.sequence),
        ]

    def to_dict(self) -> dict[str, Any]:
        """All numbers by name."""
        return {
            "sequence": self.sequence,
            "conditions": self.conditions,
            "time_offsets_s": self.time_offsets,
            "estimates": [evaluation.to_dict() for evaluation in self.evaluations],
        }


def compare(
    sequence: str, contenders: Sequence[Contender], protocol: Protocol | None = None
) -> Comparison:
    """Evaluate all estimates of a sequence under one protocol.

    Parameters
    ----------
    sequence
        Name of the sequence, for titles.
    contenders
        The estimate of interest, then its competitors.
    protocol
        How to compare.
    """
    protocol = protocol or Protocol()
    offsets: dict[str, float] = {}
    evaluations = []
    for contender in contenders:
        if protocol.align_time:
            offsets[contender.name] = find_time_offset(contender.estimate, contender.ground_truth)
        shifted = _shifted(contender.estimate, offsets.get(contender.name, 0.0))
        estimate = _body_aligned(shifted, contender.ground_truth, protocol)
        evaluations.append(_evaluate(contender, estimate, protocol))
    conditions = protocol.describe(contenders[0].ground_truth)
    return Comparison(sequence, evaluations, conditions, offsets)


def _evaluate(contender: Contender, estimate: StampedPoses, protocol: Protocol) -> Evaluation:
    stamps_ns = estimate.stamps_ns if contender.stamps_ns is None else contender.stamps_ns
    return evaluate(
        estimate,
        contender.ground_truth,
        name=contender.name,
        stamps_ns=stamps_ns if protocol.step is None else None,
        step=protocol.step or 0.01,
        aligned_at=protocol.aligned_at,
        truth_between=protocol.truth_between,
        pair=protocol.pair(estimate, contender.ground_truth),
    )


def _shifted(poses: StampedPoses, seconds: float) -> StampedPoses:
    return StampedPoses(poses.stamps_ns + round(seconds * 1e9), poses.T_world_cam)


def _body_aligned(
    estimate: StampedPoses, ground_truth: StampedPoses, protocol: Protocol
) -> StampedPoses:
    if protocol.align_body == "none":
        return estimate
    pair = protocol.pair(estimate, ground_truth)
    T_truth_estimate = find_body_offset(*pair, lever_arm=protocol.align_body == "full")
    return estimate.seen_from(se3_inverse(T_truth_estimate))
