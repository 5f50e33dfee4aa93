"""What an observer of the odometry sees after each cluster: for viewers, videos and maps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gpvo.cluster_report import ClusterReport
from gpvo.estimator import Estimator
from gpvo.events import StereoCluster
from gpvo.front_end import TrackedCluster


@dataclass(frozen=True, eq=False)
class Step:
    """One cluster, and what became of it.

    Attributes
    ----------
    cluster
        Its events.
    tracked
        Results of the front end.
    report
        Numbers of what was found.
    estimator
        The estimator after it, which must not be changed.
    """

    cluster: StereoCluster
    tracked: TrackedCluster
    report: ClusterReport
    estimator: Estimator


Observer = Callable[[Step], None]


def no_observer(step: Step) -> None:
    """Look away: the default."""


def observers(*each: Observer) -> Observer:
    """Join observers to one that calls each in turn."""

    def call_each(step: Step) -> None:
        for observer in each:
            observer(step)

    return call_each
