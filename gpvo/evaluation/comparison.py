"""Comparison of several estimates of one sequence with its ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from factors.lie import se3_inverse
from gpvo.errors import InputError, about
from gpvo.evaluation.evaluate import Evaluation, common_stamps, evaluate
from gpvo.evaluation.metrics.association import common_interval, common_part, interval_text
from gpvo.evaluation.metrics.frame_and_clock_offsets import find_body_offset, find_time_offset
from gpvo.evaluation.poses.continuous import ContinuousPoses
from gpvo.evaluation.protocol import STEP, Contender, Protocol
from gpvo.evaluation.report.machine import machine_text
from gpvo.evaluation.report.paper_tables import (
    ErrorRow,
    global_error_table,
    relative_error_table,
    summary_table,
)
from gpvo.evaluation.report.run_time import Cost, cost_table
from gpvo.evaluation.report.table import ResultTable
from gpvo.evaluation.report.weak_stretches import ShadedStretch, weak_stretches
from gpvo.trajectory import StampedPoses

STRANGE_ROTATION = 0.35
"""Median rotation error, rad (20 degrees), above which another body frame is likely."""

MOST_POSES = 1_000_000
"""Largest number of poses that --step may ask for: more take minutes and gigabytes."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Evaluations of one sequence, the estimate of interest first.

    Attributes
    ----------
    sequence
        Name of the sequence, for titles.
    evaluations
        Evaluations of the estimates.
    conditions
        Sentence on how the numbers were computed.
    time_offsets
        Seconds added to the stamps, by name of the estimate.
    stretches
        Where the estimate of interest has few measurements or none.
    published
        Published rows of other systems, for the paper's tables.
    costs
        Costs by name of the estimate, where known.
    """

    sequence: str
    evaluations: list[Evaluation]
    conditions: str
    time_offsets: dict[str, float]
    stretches: list[ShadedStretch] = field(default_factory=list)
    published: list[ErrorRow] = field(default_factory=list)
    costs: dict[str, Cost] = field(default_factory=dict)

    def tables(self) -> list[ResultTable]:
        """Return the paper's Tables I and II, ATE and RPE, and the cost."""
        rows = [*map(ErrorRow.of, self.evaluations), *self.published]
        tables = [
            global_error_table(rows, self.sequence),
            relative_error_table(rows, self.sequence),
            summary_table(self.evaluations, self.sequence),
        ]
        return [*tables, cost_table(self.costs, self.sequence)] if self.costs else tables

    def notes(self) -> list[str]:
        """Return how the numbers were computed, and on which machines."""
        machines = [
            f"Cost of {name}: {machine_text(cost.machine)}; reading included, loading kernels not."
            for name, cost in self.costs.items()
            if cost.machine
        ]
        return [self.conditions, *machines]

    def warnings(self) -> list[str]:
        """Return warnings about results that look wrong."""
        return [
            f"{evaluation.name}: orientations are far from the ground truth's, positions aligned;"
            " if it describes another body than the camera, use --align-body rotation"
            for evaluation in self.evaluations
            if evaluation.ate["se3"].rotation.median > STRANGE_ROTATION
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return all numbers by name, except those of time spent."""
        return {
            "sequence": self.sequence,
            "conditions": self.conditions,
            "time_offsets_s": self.time_offsets,
            "estimates": [evaluation.to_dict() for evaluation in self.evaluations],
        }


def compare(
    sequence: str,
    contenders: Sequence[Contender],
    protocol: Protocol | None = None,
    published: Sequence[ErrorRow] = (),
) -> Comparison:
    """Evaluate all estimates of a sequence under one protocol.

    Parameters
    ----------
    sequence
        Name of the sequence, for titles.
    contenders
        The estimate of interest, then its competitors.
    protocol
        Protocol of the comparison.
    published
        Published rows of other systems, for the paper's tables.
    """
    protocol = protocol or Protocol()
    offsets: dict[str, float] = {}
    if protocol.align_time:
        offsets = {one.name: _time_offset(one) for one in contenders}
    aligned = [one.later(offsets) for one in contenders]
    if protocol.common_time:
        aligned = _during_common_time(aligned)
    first = aligned[0].estimate
    return Comparison(
        sequence,
        [_evaluated(contender, protocol) for contender in aligned],
        protocol.describe(aligned),
        offsets,
        weak_stretches(first.trajectory) if isinstance(first, ContinuousPoses) else [],
        list(published),
        {one.name: one.cost for one in contenders if one.cost is not None},
    )


def _during_common_time(contenders: Sequence[Contender]) -> list[Contender]:
    """Return the contenders with the ground truth of the time that all of them cover."""
    intervals = [common_interval(one.estimate, one.ground_truth) for one in contenders]
    start, stop = max(first for first, _ in intervals), min(last for _, last in intervals)
    if start >= stop:
        covered = ", ".join(f"{one.name} {interval_text(one.estimate)}" for one in contenders)
        raise InputError(f"--common-time: no time that all estimates cover: {covered}")
    return [one.during(start, stop) for one in contenders]


def _time_offset(contender: Contender) -> float:
    with about(contender.files or contender.name):
        return find_time_offset(contender.estimate, contender.ground_truth)


def _evaluated(contender: Contender, protocol: Protocol) -> Evaluation:
    with about(contender.files or contender.name):
        return _evaluate(contender, protocol)


def _evaluate(contender: Contender, protocol: Protocol) -> Evaluation:
    truth, states = contender.ground_truth, contender.estimate
    sampled = _asked_at(_stamps(contender, protocol), contender)
    if contender.continuous:
        states = _asked_at(truth.stamps_ns, contender)
    pair = protocol.pair(states, truth)
    if protocol.align_body != "none":
        T_truth_estimate = find_body_offset(*pair, lever_arm=protocol.align_body == "full")
        T_estimate_truth = se3_inverse(T_truth_estimate)
        sampled = sampled.seen_from(T_estimate_truth)
        pair = pair[0].seen_from(T_estimate_truth), pair[1]
    return evaluate(
        sampled,
        truth,
        name=contender.name,
        stamps_ns=sampled.stamps_ns,
        aligned_at=protocol.aligned_at,
        truth_between=protocol.truth_between,
        pair=pair,
    )


def _stamps(contender: Contender, protocol: Protocol) -> NDArray[np.int64]:
    """Return the stamps at which to compare."""
    if protocol.step is not None:
        return _every_step(contender.estimate, contender.ground_truth, protocol.step)
    if contender.at_states_of is not None:
        return _states_of(contender.at_states_of, contender)
    if contender.continuous:
        return common_stamps(contender.estimate, contender.ground_truth, STEP)
    return contender.estimate.stamps_ns


def _states_of(other: Contender, contender: Contender) -> NDArray[np.int64]:
    place = f"compared at the states of {other.name}, {interval_text(other.estimate)}"
    with about(place):
        return common_part(other.estimate.stamps_ns, contender.estimate, contender.ground_truth)


def _every_step(
    estimate: StampedPoses, ground_truth: StampedPoses, step: float
) -> NDArray[np.int64]:
    start, stop = common_interval(estimate, ground_truth)
    count = (stop - start) * 1e-9 / step
    if count > MOST_POSES:
        raise InputError(
            f"--step {step:g}: compares {count:.0f} poses; take a longer step, for {MOST_POSES} at"
            " most"
        )
    return common_stamps(estimate, ground_truth, step)


def _asked_at(stamps_ns: NDArray[np.int64], contender: Contender) -> StampedPoses:
    """Return the estimate at those stamps that both cover."""
    inside_ns = common_part(stamps_ns, contender.estimate, contender.ground_truth)
    return contender.estimate.interpolate(inside_ns)
