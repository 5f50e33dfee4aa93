"""Protocol of a comparison, and the estimates that take part in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from gpvo.errors import InputError
from gpvo.evaluation.evaluate import Interpolation
from gpvo.evaluation.metrics.association import associate, resample, tolerance_for
from gpvo.evaluation.metrics.paper_errors import FrameTransform
from gpvo.evaluation.poses.continuous import ContinuousPoses
from gpvo.evaluation.report.run_time import Cost
from gpvo.trajectory import StampedPoses

Association = Literal["nearest", "interpolated"]
BodyAlignment = Literal["none", "rotation", "full"]

STEP = 0.01
"""Seconds between the poses of a continuous trajectory that are compared."""

STEP_RESOLUTION = 1e-6
"""Shortest allowed step, seconds."""


@dataclass(frozen=True)
class Protocol:
    """Options of the comparison of estimates with the ground truth.

    Attributes
    ----------
    step
        Seconds between compared poses. None as in the paper: compare at each contender's states,
        see `Contender`.
    truth_between
        Interpolation of the ground truth, see `evaluate`.
    association
        Poses for ATE, RPE and drift: the "nearest" in time, like evo's, or the denser trajectory
        "interpolated" at the stamps of the sparser one.
    max_difference
        Largest time between associated poses, seconds. None: 0.02, or 0.3 intervals of a sparse
        truth.
    aligned_at
        Frame transform of the relative error, see `relative_error`.
    align_body
        First remove the constant "rotation", or the "full" transform, between the estimated body
        and the ground truth's.
    align_time
        First remove the constant offset between the clocks.
    common_time
        Compare only the time that all estimates of the sequence cover, instead of each one's own.

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
    common_time: bool = False

    def __post_init__(self) -> None:
        if self.step is not None and not STEP_RESOLUTION <= self.step < np.inf:
            raise InputError(f"--step {self.step:g}: give seconds, at least {STEP_RESOLUTION:g}")
        if self.max_difference is not None and not 0.0 <= self.max_difference < np.inf:
            raise InputError(f"--max-difference {self.max_difference:g}: give seconds, 0 or more")

    def pair(
        self, estimate: StampedPoses, ground_truth: StampedPoses
    ) -> tuple[StampedPoses, StampedPoses]:
        """Return the associated poses of the estimate and of the ground truth."""
        if self.association == "interpolated":
            return resample(estimate, ground_truth)
        return associate(estimate, ground_truth, self.tolerance(ground_truth))

    def tolerance(self, ground_truth: StampedPoses) -> float:
        """Return the largest time between associated poses, seconds."""
        if self.max_difference is None:
            return tolerance_for(ground_truth)
        return self.max_difference

    def describe(self, contenders: Sequence[Contender]) -> str:
        """Return a sentence on the comparison, for below the tables."""
        where = f"every {self.step:g} s" if self.step else places(contenders)
        between = "by the Gaussian process" if self.truth_between == "gp" else "linearly"
        text = f"Compared {where}, first poses aligned, ground truth interpolated {between}; "
        if self.association == "nearest":
            tolerance = self.tolerance(contenders[0].ground_truth)
            text += f"ATE, RPE, drift: poses within {tolerance:.2g} s"
        else:
            text += "ATE, RPE, drift: interpolated at the sparser trajectory's stamps"
        truth_gaps = contenders[0].ground_truth.gaps_ns
        if len(truth_gaps):
            seconds = np.diff(truth_gaps).sum() * 1e-9
            text += f"; nothing within the ground truth's gaps, {seconds:.3g} s in all"
        if self.common_time:
            text += "; only the time that all estimates cover"
        if self.align_body != "none":
            text += f"; constant body offset removed ({self.align_body})"
        return text + ("; constant clock offset removed." if self.align_time else ".")


@dataclass(frozen=True)
class Contender:
    """An estimate and its ground truth.

    A discrete estimate is compared at its own states, a continuous one every 0.01 s. With
    `at_states_of` it is compared at the states of another contender: the paper uses the
    competitor's states, so that both have the same time between poses. `files` are for messages.
    """

    name: str
    estimate: StampedPoses
    ground_truth: StampedPoses
    at_states_of: Contender | None = None
    cost: Cost | None = None
    files: str = ""

    def later(self, offsets: Mapping[str, float]) -> Contender:
        """Return the same with seconds, by name, added to the estimates' stamps."""
        other = self.at_states_of
        return replace(
            self,
            estimate=self.estimate.later(round(1e9 * offsets.get(self.name, 0.0))),
            at_states_of=None if other is None else other.later(offsets),
        )

    def during(self, start_ns: int, stop_ns: int) -> Contender:
        """Return the same, of whose ground truth only the poses from start to stop are known."""
        return replace(self, ground_truth=self.ground_truth.between(start_ns, stop_ns))

    @property
    def continuous(self) -> bool:
        """Whether the estimate can be evaluated at any time."""
        return isinstance(self.estimate, ContinuousPoses)

    @property
    def place(self) -> str:
        """Description of the stamps at which the estimate is compared."""
        if self.at_states_of is not None:
            return f"at the states of {self.at_states_of.name}"
        return f"every {STEP:g} s" if self.continuous else "at each estimate's own states"


def places(contenders: Sequence[Contender]) -> str:
    """Describe the stamps at which the estimates are compared."""
    groups: dict[str, list[str]] = {}
    for contender in contenders:
        groups.setdefault(contender.place, []).append(contender.name)
    if len(groups) == 1:
        return contenders[0].place
    return ", ".join(f"{' and '.join(names)} {place}" for place, names in groups.items())
