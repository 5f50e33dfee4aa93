"""Verdict on a run: how much of it was measured, how much is dead reckoning, what was faulty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from typing import Literal

import numpy as np

from gpvo.cluster_report import ClusterReport
from gpvo.faults import Fault
from gpvo.trajectory import Trajectory

Word = Literal["good", "degraded", "failed"]
SHORT = 0.25
"""Seconds of dead reckoning that the motion prior bridges well."""
RARE = 0.05
"""Share of the time that may be dead reckoning in a good run."""
MOSTLY = 0.5
"""Share of the time from which a trajectory is mostly dead reckoning."""
START_UP = 0.5
"""Seconds of motion in which the first landmarks should be found."""


@dataclass(frozen=True)
class Stretch:
    """Seconds `start` to `stop` of which every cluster hardly measures the motion."""

    start: float
    stop: float

    @property
    def duration(self) -> float:
        """Duration, seconds."""
        return self.stop - self.start


@dataclass(frozen=True)
class Verdict:
    """Verdict on a run.

    Attributes
    ----------
    word
        good, degraded where a part is dead reckoning or the events are faulty, failed where most of
        it is dead reckoning, it ends before what was measured, or a fault makes it wrong by more
        than its covariance says.
    reasons
        What was seen, a line each; none for a good run.
    dead_reckoning
        Share of the time with hardly any inliers, from 0 to 1.
    stretches
        Where they are.
    deviation
        Standard deviation of the position after the longest of them, metres; None if unknown.
    faults
        What was found in the events, those that do no harm too.
    """

    word: Word
    reasons: tuple[str, ...]
    dead_reckoning: float
    stretches: tuple[Stretch, ...]
    deviation: float | None = None
    faults: tuple[Fault, ...] = ()

    def to_dict(self) -> dict[str, object]:
        """Return the verdict as plain values."""
        longest = max((one.duration for one in self.stretches), default=0.0)
        return {
            "verdict": self.word,
            "reasons": list(self.reasons),
            "dead_reckoning": self.dead_reckoning,
            "longest_dead_reckoning_s": longest,
            "deviation_after_it_m": self.deviation,
            "stretches_s": [[one.start, one.stop] for one in self.stretches],
            "faults": [fault.to_dict() for fault in self.faults],
        }


def verdict(
    reports: Sequence[ClusterReport],
    faults: Sequence[Fault] = (),
    trajectory: Trajectory | None = None,
) -> Verdict:
    """Judge a run by its clusters, one or more in order of time, and by what was found faulty."""
    stretches = unmeasured(reports)
    whole = reports[-1].stop - reports[0].start
    share = sum(one.duration for one in stretches) / whole
    deviation = _deviation(stretches, trajectory)
    known = f"; then the position is known to {deviation:.2f} m" if deviation else ""
    harm = tuple(f"{one.kind} from {one.t:.2f} s on" for one in faults if one.harms)
    wrong = _ends_early(reports, trajectory) + tuple(
        f"{one.kind}: wrong by more than the covariance says" for one in faults if one.fails
    )
    if share >= MOSTLY:
        lost = f"{100 * share:.0f} % of the time is dead reckoning: {_listed(stretches)}{known}"
        reasons: tuple[str, ...] = (lost, *wrong, *harm)
    else:
        moved = next((one.start for one in reports if not one.at_rest), reports[0].start)
        reasons = (*wrong, *_reasons(stretches, whole, moved, known), *harm)
    word: Word = "failed" if wrong or share >= MOSTLY else "degraded" if reasons else "good"
    return Verdict(word, reasons, share, stretches, deviation, tuple(faults))


def _deviation(stretches: Sequence[Stretch], trajectory: Trajectory | None) -> float | None:
    """Return the position's standard deviation after the longest stretch, metres."""
    if not stretches or trajectory is None or len(trajectory.knots) < 2:
        return None
    longest = max(stretches, key=lambda one: one.duration)
    stop = np.clip(longest.stop, trajectory.start, trajectory.stop)
    return float(np.sqrt(np.trace(trajectory.covariance(stop)[3:6, 3:6])))


def _ends_early(reports: Sequence[ClusterReport], trajectory: Trajectory | None) -> tuple[str, ...]:
    """Say where the trajectory ends if the estimator was given measurements long after."""
    last = max((one.start for one in reports if one.measurements), default=-np.inf)
    if trajectory is None or last - trajectory.stop <= SHORT:
        return ()
    return (
        f"the trajectory ends at {trajectory.stop:.2f} s, the measurements at {last:.2f} s: they do"
        " not fit the configuration's `noise`",
    )


def unmeasured(reports: Sequence[ClusterReport]) -> tuple[Stretch, ...]:
    """Return the stretches of consecutive clusters that hardly measure the motion."""
    hardly_measures = attrgetter("hardly_measures")
    runs = [list(clusters) for hardly, clusters in groupby(reports, hardly_measures) if hardly]
    return tuple(Stretch(run[0].start, run[-1].stop) for run in runs)


def _reasons(
    stretches: Sequence[Stretch], whole: float, begin: float, known: str
) -> tuple[str, ...]:
    reasons = []
    late = [one for one in stretches if one.start == begin and one.duration > START_UP]
    if late:
        reasons.append(f"the first landmarks were found after {late[0].duration:.2f} s")
    later = [one for one in stretches if one.start > begin]
    long = [one for one in later if one.duration > SHORT]
    share = sum(one.duration for one in later) / whole
    if long:
        reasons.append(f"dead reckoning of more than {SHORT:g} s: {_listed(long)}{known}")
    elif share > RARE:
        reasons.append(f"{100 * share:.0f} % of the time is dead reckoning: {_listed(later)}")
    return tuple(reasons)


def _listed(stretches: Sequence[Stretch]) -> str:
    """Return the longest stretches, at most three, in order of time."""
    longest = sorted(stretches, key=lambda one: -one.duration)[:3]
    parts = [f"{one.start:.2f} to {one.stop:.2f} s" for one in sorted(longest, key=_start)]
    more = len(stretches) - len(longest)
    return ", ".join(parts) + (f" and {more} more" if more else "")


def _start(stretch: Stretch) -> float:
    return stretch.start
