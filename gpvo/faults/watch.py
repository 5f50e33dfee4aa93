"""All detectors together: what they see of the stream, and what they say of it."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from typing import Any

from gpvo.cluster_report import ClusterReport
from gpvo.events import StereoCluster
from gpvo.faults.clocks import ClockWatch
from gpvo.faults.doubled import DoubledEvents
from gpvo.faults.fault import Fault
from gpvo.faults.flashes import leaves_out
from gpvo.faults.outliers import many_outliers
from gpvo.faults.rates import different_rates
from gpvo.faults.silence import Silence
from gpvo.faults.views import Views
from gpvo.lost_stage import EARLY, is_lost, lost_stage
from gpvo.recordings import StereoEvents, StereoRig

log = logging.getLogger("gpvo.faults")


class FaultWatch:
    """Finds faults while the events come, and warns of each kind once.

    Attributes
    ----------
    faults
        What was found so far, in order.
    """

    def __init__(self, rig: StereoRig) -> None:
        self.faults: list[Fault] = []
        self._seconds, self._events = 0.0, [0, 0]
        self._silence, self._clocks = Silence(), ClockWatch(rig)
        self._doubled, self._views = DoubledEvents(), Views()
        self._reports: list[ClusterReport] = []
        self._is_early = True

    @property
    def numbers(self) -> dict[str, Any]:
        """What was measured of the stream so far: rates, silences, offset of the clocks."""
        left, right = (count / max(self._seconds, 1e-9) for count in self._events)
        offset = self._clocks.latest
        return {
            "left_events_per_s": left,
            "right_events_per_s": right,
            "silences_s": {
                side: list(map(list, many)) for side, many in self._silence.silences.items()
            },
            "clock_offset_s": offset.seconds if offset else None,
            "clock_offset_deviation_s": offset.deviation if offset else None,
        }

    def see_events(self, batch: StereoEvents | None) -> None:
        """Look at the next events of the stream, in batches of any length.

        None where events were left out on purpose: that is no fault of the cameras.
        """
        if batch is None:
            self._silence.begin_again()
            return
        self._seconds += batch.stop - batch.start
        self._events[0] += len(batch.left)
        self._events[1] += len(batch.right)
        self._say(self._silence.see(batch))
        self._say(self._doubled.see(batch))
        if not self._is_silent:
            self._say(self._clocks.see(batch))

    def see_cluster(self, cluster: StereoCluster, report: ClusterReport) -> None:
        """Look at the next cluster, and at what became of it."""
        self._reports.append(report)
        self._say(leaves_out(report))
        if not self._is_silent:
            self._say(different_rates(self._reports))
        if not report.at_rest:
            self._say(self._views.see(cluster))
            self._say(many_outliers(self._reports))
        self._say(self._lost())

    @property
    def _is_silent(self) -> bool:
        """Whether one of the cameras was silent, so that they cannot be compared."""
        return any("silent" in fault.kind for fault in self.faults)

    def _lost(self) -> Iterator[Fault]:
        """Say once, after the first second, where landmarks are lost if most are."""
        first, latest = self._reports[0], self._reports[-1]
        if self._is_early and latest.stop - first.start >= EARLY:
            self._is_early = False
            if is_lost(self._reports) and not any(fault.harms for fault in self.faults):
                yield Fault("lost", first.start, lost_stage(self._reports))

    def _say(self, found: Iterable[Fault]) -> None:
        for fault in found:
            if all(fault.kind != known.kind for known in self.faults):
                log.warning("%s", fault.line)
                self.faults.append(fault)
