"""Verdict on a run: how much of it was measured, and how much is dead reckoning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

from gpvo.cluster_report import ClusterReport

FEW = 6
"""Number of inliers below which a cluster hardly measures the motion: twice the smallest sample."""
SHORT = 0.25
"""Seconds of dead reckoning that the motion prior bridges well."""
RARE = 0.05
"""Share of the time that may be dead reckoning in a good run."""
MOSTLY = 0.5
"""Share of the time from which a trajectory is mostly dead reckoning."""
START_UP = 0.5
"""Seconds in which the first landmarks should be found."""


@dataclass(frozen=True)
class Stretch:
    """Seconds `start` to `stop` with fewer than FEW inliers in every cluster."""

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
        good, degraded where a part is dead reckoning, failed where most of it is.
    reasons
        What was seen, a line each; none for a good run.
    dead_reckoning
        Share of the time with fewer than FEW inliers, from 0 to 1.
    stretches
        Where they are.
    """

    word: Literal["good", "degraded", "failed"]
    reasons: tuple[str, ...]
    dead_reckoning: float
    stretches: tuple[Stretch, ...]

    def to_dict(self) -> dict[str, object]:
        """Return the verdict as plain values."""
        return {
            "verdict": self.word,
            "reasons": list(self.reasons),
            "dead_reckoning": self.dead_reckoning,
            "stretches_s": [[one.start, one.stop] for one in self.stretches],
        }


def verdict(reports: Sequence[ClusterReport]) -> Verdict:
    """Judge a run by the inliers of its clusters, in order of time, one or more."""
    stretches = unmeasured(reports)
    whole = reports[-1].stop - reports[0].start
    share = sum(one.duration for one in stretches) / whole
    if share >= MOSTLY:
        reason = f"{100 * share:.0f} % of the time is dead reckoning: {_listed(stretches)}"
        return Verdict("failed", (reason,), share, stretches)
    reasons = _reasons(stretches, whole, reports[0].start)
    return Verdict("degraded" if reasons else "good", reasons, share, stretches)


def unmeasured(reports: Sequence[ClusterReport]) -> tuple[Stretch, ...]:
    """Return the stretches of consecutive clusters that hardly measure the motion."""
    runs = [list(clusters) for hardly, clusters in groupby(reports, _hardly_measures) if hardly]
    return tuple(Stretch(run[0].start, run[-1].stop) for run in runs)


def _hardly_measures(report: ClusterReport) -> bool:
    return report.inliers < FEW and not report.at_rest


def _reasons(stretches: Sequence[Stretch], whole: float, begin: float) -> tuple[str, ...]:
    reasons = []
    late = [one for one in stretches if one.start == begin and one.duration > START_UP]
    if late:
        reasons.append(f"the first landmarks were found after {late[0].duration:.2f} s")
    later = [one for one in stretches if one.start > begin]
    long = [one for one in later if one.duration > SHORT]
    share = sum(one.duration for one in later) / whole
    if long:
        reasons.append(f"dead reckoning of more than {SHORT:g} s: {_listed(long)}")
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
