"""Motion compensation: pictures of clusters, made with the motion of the features seen in them.

Events are moved along the image motion of the latest tracked features. This motion is assumed to be
the same between neighbouring features and constant in time. Errors of this assumption cancel for
features, because each feature is moved back to the mean time of its own events.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from functools import partial
from math import hypot

import numpy as np
from numpy.typing import NDArray

from gpvo.config.stages import CompensationConfig
from gpvo.events import ClusterEvents, StereoCluster
from gpvo.second_thread import both
from gpvo.tracking.compensated_image import CompensatedImage
from gpvo.tracking.contour_lag import StereoLag
from gpvo.tracking.contour_way import ContourWay
from gpvo.tracking.event_sums import Flow
from gpvo.tracking.feature_flow import direction, flow_between, median_length
from gpvo.tracking.missing_data import MissingData
from gpvo.tracking.observations import Observations
from gpvo.tracking.rest import Rest
from gpvo.tracking.sharpest_flow import sharpest_flow

Array = NDArray[np.float64]

LEAST_FEATURES = 8
"""Number of features below which the image motion is unknown."""
UNSURE = 4.0
"""How many times larger deviations are at most, and while the lag is unknown: all points are off
alike."""
TURN = 0.1
"""Turn of the lag in a cluster, pixels, from which its errors are larger than the matches'.

It is not known which contours have turned already. On 96 simulated recordings the relative errors
were 0.96 times those without, and 0.81 in motion back and forth.
"""
BLURRED = 3.0
"""Way of contours between the first two pictures, pixels, from which they are better made again.

On 144 simulated recordings the position's RMS was 0.82 times that without from 4 pixels on, 0.87
from 3 to 4, and 1.03 below.
"""
UNKNOWN: Flow = np.zeros((1, 1, 2), np.float32)
"""Image motion if it is unknown: none."""


class MotionCompensation:
    """Pictures of clusters, compensated by the image motion of the features tracked in them.

    Where (almost) no event came but the noise of both cameras, nothing moved: such a cluster has
    the pictures before it, at its own time, so that features are seen at rest, or blank ones if
    nothing moved before. Without noise the cameras may as well have failed. Where few events of
    contours tell that these moved by less than a little, the pictures go on showing those before,
    but not where data is missing.

    `frames` is the number of latest clusters to which observations may belong. Pixels of the
    pictures are `side` pixels of the events wide; all positions are pixels of the pictures.
    `at_rest` says whether nothing moved in the latest cluster, `hardly_moved` whether contours
    moved by less than a little since the picture before, `turns` whether they did in it or in the
    one before. `blurred` says whether the latest two pictures told the image motion for the first
    time, and move far: made again with it, they are sharper.
    """

    def __init__(self, config: CompensationConfig, frames: int, side: int = 1) -> None:
        self._config, self._side = config, side
        self._images: deque[tuple[CompensatedImage, CompensatedImage]] = deque(maxlen=frames)
        self._frame_count = 0
        self._stop, self._pause = -np.inf, 0.0
        self.hardly_moved = self.turns = self.blurred = False
        self._moving: tuple[CompensatedImage, ...] = ()  # the latest pictures that show contours
        self._showing = False  # whether those before do
        self._recent: Observations | None = None
        self._waiting: Observations | None = None
        self._flows: tuple[Flow, Flow] = UNKNOWN, UNKNOWN
        self._learned, self._doubts = 0, deque[Array](maxlen=frames)
        self._lag = StereoLag(config.lag_share, side)
        self._cluster: StereoCluster | None = None
        self._way = ContourWay(config.little_motion)
        self._rest, self._missing = Rest(), MissingData()

    @property
    def at_rest(self) -> bool:
        """Whether nothing moved in the latest cluster."""
        return self._rest.at_rest

    @property
    def thinned(self) -> int:
        """Number of events of both cameras that the latest pictures leave out."""
        return sum(image.thinned for image in self._images[-1]) if self._images else 0

    def pictures(self, cluster: StereoCluster) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Make the left and right picture of a new cluster at the middle of its interval."""
        middle = cluster.middle
        self._pause, self._stop = cluster.start - self._stop, cluster.stop
        self._cluster, self.blurred = cluster, False
        self._rest.see(cluster)
        before = self.hardly_moved
        self.hardly_moved = self._moved_little(cluster, middle) and not self.at_rest
        self.turns = before or self.hardly_moved
        left, right = self._images_of(cluster, middle)
        self._images.append((left, right))
        doubt = self._way.doubt(direction(self._flows[0])) if self.hardly_moved else np.ones(2)
        self._doubts.append(doubt)
        self._frame_count += 1
        return left.picture, right.picture

    def _images_of(
        self, cluster: StereoCluster, middle: float
    ) -> tuple[CompensatedImage, CompensatedImage]:
        """Make the left and right image at `middle`, by what moved in the cluster."""
        if self.at_rest and self._moving:
            left, right = (image.held(middle) for image in self._moving)
        elif self.at_rest:
            left, right = (self._blank(side, middle) for side in (cluster.left, cluster.right))
        elif self.hardly_moved:
            left, right = self._continued(cluster, middle)
        else:
            flows = self._flows_in(cluster)
            left, right = both(
                partial(self._compensated, cluster.left, flows[0], middle),
                partial(self._compensated, cluster.right, flows[1], middle),
            )
            self._showing = not self._rest.is_still
        if self._showing and not self.at_rest:
            self._moving = left, right
        return left, right

    def _flows_in(self, cluster: StereoCluster) -> tuple[Flow, Flow]:
        """Return what the latest features tell; if these are lost, what makes sharp pictures.

        The motion before may have turned, and blurs more than none.
        """
        told = len(self._images) < 2 or self._learned == self._frame_count
        if told or self._flows[0] is UNKNOWN or not self._config.sharpest:
            return self._flows
        flow = sharpest_flow(cluster.left, cluster.start, cluster.stop, self._side)
        return (UNKNOWN, UNKNOWN) if flow is None else (flow, flow)

    def take_back(self) -> None:
        """Forget the latest two pictures, and what was seen in them; keep the motion they told."""
        for _ in range(2):
            self._images.pop()
            self._doubts.pop()
        self._frame_count -= 2
        self._recent, self._learned, self._stop = None, 0, -np.inf

    def _compensated(self, events: ClusterEvents, flow: Flow, middle: float) -> CompensatedImage:
        density = self._config.density
        return CompensatedImage.of_events(events, flow, middle, self._side, density)

    def _continued(
        self, cluster: StereoCluster, middle: float
    ) -> tuple[CompensatedImage, CompensatedImage]:
        """Make the pictures before at a later time, with the few events since."""
        left, right = (
            image.continued(self._compensated(side, UNKNOWN, middle), 1 - self._way.share)
            for image, side in zip(self._images[-1], (cluster.left, cluster.right), strict=True)
        )
        return left, right

    def _blank(self, events: ClusterEvents, middle: float) -> CompensatedImage:
        """Make the image of a camera at rest that saw nothing move before."""
        nothing = replace(events, parts=())
        return CompensatedImage.of_events(nothing, UNKNOWN, middle, self._side)

    def _moved_little(self, cluster: StereoCluster, middle: float) -> bool:
        """Return whether the contours of both cameras moved by less than a little, at `middle`."""
        if not self._images:
            return False
        if self._missing.is_in(cluster):
            self._way.lose()
            return False
        dt = middle - self._images[-1][0].reference
        self._way.see(cluster.contour_count, cluster.stop - cluster.start, dt)
        return self._way.is_little

    def timed(self, seen: Observations) -> Observations:
        """Move observations from the pictures to the mean times of their events; add the times.

        There they are moved ahead by the contours' lag. The second cluster tells it: the first
        observations come with those of the second. Where it turns, or is unknown later, deviations
        of left points are larger. Disparities stay those of the pictures, which have the same
        reference time, but for the lags: near things move otherwise in the left image than in the
        right one.
        """
        self._remember(seen)
        self._learn_flows()
        seen = self._with_waiting(seen)
        left, right, times = seen.left.copy(), seen.right.copy(), np.empty((len(seen), 2))
        deviations, oldest = seen.deviations.copy(), self._frame_count - len(self._images)
        known = zip(self._images, self._doubts, strict=True)
        for number, ((left_image, right_image), doubt) in enumerate(known, oldest):
            now, radius = seen.frame == number, self._config.time_radius
            if not now.any():
                continue
            (left[now], times[now, 0]), (_, times[now, 1]) = both(
                partial(left_image.at_own_times, seen.left[now], radius),
                partial(right_image.at_own_times, seen.right[now], radius),
            )
            right[now] += left[now] - seen.left[now]
            ahead = self._lag.left.ahead(seen.left[now])
            left[now] += ahead
            right[now, 0] += self._lag.right.ahead(seen.right[now])[:, 0]
            right[now, 1] += ahead[:, 1]  # the row is measured on the left
            deviations[now, :2] *= doubt
        return replace(seen, left=left, right=right, own_times=times, own_deviations=deviations)

    def _with_waiting(self, seen: Observations) -> Observations:
        """Let observations wait for the next cluster until the motion tells their lag."""
        if self._waiting is not None:
            seen, self._waiting = Observations.concatenate([self._waiting, seen]), None
        elif self._config.lag_share > 0 and self._flows[0] is UNKNOWN and len(seen):
            seen, self._waiting = seen[:0], seen
        return seen

    def _remember(self, seen: Observations) -> None:
        """Keep the observations of the two latest clusters."""
        known = seen if self._recent is None else Observations.concatenate([self._recent, seen])
        self._recent = known[known.frame >= self._frame_count - 2]

    def _learn_flows(self) -> None:
        """Learn what features that both latest clusters saw tell of the motion, if they are enough.

        Once: observations that are added later are not of both clusters.
        """
        if self._recent is None or len(self._images) < 2 or self._learned == self._frame_count:
            return
        seen, newest = self._recent, self._recent.frame == self._frame_count - 1
        earlier, later = seen[~newest], seen[newest]
        _, i, j = np.intersect1d(earlier.landmark, later.landmark, return_indices=True)
        if len(i) >= LEAST_FEATURES:
            self._learn_motion(earlier[i], later[j])
        elif len(later) >= 2 * LEAST_FEATURES:
            self._doubt(UNSURE)

    def _learn_motion(self, earlier: Observations, later: Observations) -> None:
        """Estimate left and right image motion from the same features in the latest clusters."""
        before, latest = (left for left, _ in list(self._images)[-2:])
        dt = latest.reference - before.reference
        height, width = latest.count.shape
        left, right = (
            flow_between(old, new, dt, (height, width), self._config.reach)
            for old, new in ((earlier.left, later.left), (earlier.right, later.right))
        )
        self.blurred = self._flows[0] is UNKNOWN and median_length(left) * dt > BLURRED
        self._flows, self._learned = (left, right), self._frame_count
        if not self.at_rest:
            self._way.learn(median_length(left))
            self._follow_lag(dt)

    def _follow_lag(self, dt: float) -> None:
        """Let the lag follow the image motion, dt seconds after that of the cluster before.

        Where the motion turns, contours vanish, and those that are seen then are others: the lag
        is still that of before.
        """
        if self._config.lag_share == 0 or self._cluster is None:
            return
        change = self._lag.follow(self._cluster, self._flows, dt, dt - self._pause)
        self._doubt(min(UNSURE, hypot(1, median_length(change) / TURN)))

    def _doubt(self, times: float) -> None:
        """Let deviations of the latest left points be so many times larger at least."""
        if self._config.lag_share > 0:
            self._doubts[-1] = np.maximum(self._doubts[-1], times)
