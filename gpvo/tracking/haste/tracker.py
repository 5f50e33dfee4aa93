"""Tracking of features event by event, so that every measurement has its own time.

HASTE's hypotheses move a patch by pixels, at the event that makes a move more likely. A landmark is
measured by the events at the last move of its patch in a cluster, or by its latest events if it did
not move. These events are aligned with the template to a fraction of a pixel, and their mean time
is that of the measurement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.config import TrackingConfig
from gpvo.events import ClusterEvents, StereoCluster
from gpvo.tracking.features import extrema, smooth, strongest_spaced
from gpvo.tracking.haste.event_rows import EventRows, event_rows, latest_around
from gpvo.tracking.haste.hypotheses import Patches, follow, judge, new_patches
from gpvo.tracking.haste.stereo_matching import match_right, mean_time
from gpvo.tracking.haste.templates import BORDER, align, blur_kernel, draw, normalized
from gpvo.tracking.observations import Observations

Array = NDArray[np.float64]

FARTHEST = 3.0
"""Largest shift of an alignment, pixels; a patch's pose is known to about a pixel."""
DISPARITY_CHANGE = 4
"""Largest change of disparity between two measurements, pixels."""


@dataclass(frozen=True, eq=False)
class _Sighting:
    """Patch seen in both images: left pose (3,), right pixel (2,), and times (2,) of both."""

    landmark: int
    pose: Array
    right: Array
    times: Array

    @property
    def disparity(self) -> float:
        return float(self.pose[0] - self.right[0])


class EventTracker:
    """Tracker of patches of events; see `gpvo.tracking.Tracker`."""

    def __init__(self, config: TrackingConfig) -> None:
        self._config = config.event
        self._features = config.features
        self._kernel = blur_kernel(config.event.smoothing)
        self._size = config.event.patch_size + 2 * BORDER
        self._reach = 0.5 * self._size + len(self._kernel) // 2
        self._rotation = np.radians(config.event.rotation_step)
        self._patches = new_patches(self._size, config.event.window)
        self._left = self._right = np.empty((0, 3))  # u, v and time of the latest events
        self._frame_count = 0
        self._landmark_count = 0

    def track(self, cluster: StereoCluster) -> Observations:
        """Follow the known landmarks through a new cluster and find new ones in it."""
        left, right = _columns(cluster.left), _columns(cluster.right)
        follow(left, self._patches, self._rotation, self._reach, self._config.margin)
        since = cluster.start - self._config.memory
        self._left, self._right = _after(since, self._left, left), _after(since, self._right, right)
        height, self._width = cluster.left.surface_of_active_events.shape
        rows = event_rows(self._right, height)
        seen = self._measure(cluster.start, rows)
        seen += self._detect(cluster.left, event_rows(self._left, height), rows)
        self._frame_count += 1
        return self._observations(seen)

    def _measure(self, start: float, right: EventRows) -> list[_Sighting]:
        """Measure patches with enough new events; drop those not found or not measured for long."""
        patches, seen = self._patches, []
        keep = patches.frame >= self._frame_count - self._config.patience
        for k in np.flatnonzero(keep).tolist():
            events = self._fresh(k)
            if len(events) < self._config.min_events or events[:, 2].max() < start:
                continue
            sighting = self._find(k, events, right)
            if sighting is None:
                keep[k] = False
            else:
                seen.append(sighting)
                self._update(k, events, sighting)
        self._patches = patches.select(keep)
        return seen

    def _fresh(self, k: int) -> Array:
        """Return the events (N, 3) by which patch k moved last, without those measured before.

        They are the latest events if it did not move since. The template contains the measured ones
        already, which would hold the patch back at its old position.
        """
        patches = self._patches
        events = self._recent(patches.moving[k] if patches.moved[k] else patches.window[k])
        return events[events[:, 2] > patches.measured[k]]

    def _find(self, k: int, events: Array, right: EventRows) -> _Sighting | None:
        """Align patch k with its events; return None if it is not found or its pose is unclear."""
        patches = self._patches
        pose, _, deviation = align(events, patches.template[k], patches.pose[k], self._kernel, 3)
        moved = np.abs(pose[:2] - patches.pose[k, :2]).max()
        if deviation > self._config.max_deviation or moved > FARTHEST:
            return None
        middle = round(patches.disparity[k])
        search = (max(0, middle - DISPARITY_CHANGE), middle + DISPARITY_CHANGE)
        return self._in_stereo(int(patches.landmark[k]), pose, events, right, search)

    def _in_stereo(
        self, landmark: int, pose: Array, events: Array, right: EventRows, search: tuple[int, int]
    ) -> _Sighting | None:
        """Match a patch in the right image; return None if the match is not clear."""
        border, height = 0.5 * self._config.patch_size, len(right.start) - 1
        if not (border <= pose[0] < self._width - border and border <= pose[1] < height - border):
            return None
        pixel, t_right, likeness, deviation = match_right(
            events, right, pose[:2], self._size, search, self._kernel
        )
        clear = deviation <= self._config.max_deviation
        if not clear or likeness < self._config.min_stereo_correlation or pixel[0] >= pose[0]:
            return None
        return _Sighting(landmark, pose, pixel, np.array([mean_time(events), t_right]))

    def _update(self, k: int, events: Array, sighting: _Sighting) -> None:
        """Move patch k to its sighting and blend its template with its present appearance."""
        patches, rate = self._patches, self._config.template_rate
        image = normalized(draw(events, sighting.pose, (self._size, self._size), self._kernel))
        patches.template[k] = normalized((1 - rate) * patches.template[k] + rate * image)
        patches.pose[k], patches.disparity[k] = sighting.pose, sighting.disparity
        patches.frame[k], patches.moved[k] = self._frame_count, False
        patches.measured[k] = events[:, 2].max()
        judge(patches, k, self._rotation)

    def _detect(self, image: ClusterEvents, left: EventRows, right: EventRows) -> list[_Sighting]:
        """Add the strongest features that are not near a landmark and have a right match."""
        points, _, strength = extrema(
            smooth(image.binary_frame, self._config.smoothing),
            self._features.nms_radius,
            self._features.response_threshold,
        )
        taken = self._patches.pose[:, :2].astype(np.float32)
        wanted = self._config.max_features - len(taken)
        seen, added = [], [self._patches]
        for k in strongest_spaced(points, strength, taken, self._config.spacing, wanted):
            pose = np.array([*points[k], 0.0])
            near = latest_around(left, pose[:2], self._reach, self._config.window)
            events = self._recent(near)
            if len(events) < self._config.min_events:
                continue
            whole = (0, self._config.max_disparity)
            sighting = self._in_stereo(self._landmark_count, pose, events, right, whole)
            if sighting is not None:
                self._landmark_count += 1
                seen.append(sighting)
                added.append(self._patch(sighting, events))
        self._patches = Patches.concatenate(added)
        return seen

    def _patch(self, sighting: _Sighting, events: Array) -> Patches:
        """Make the patch of a new landmark, which starts with the events that showed it."""
        patch = new_patches(self._size, self._config.window, 1)
        patch.landmark[0], patch.frame[0] = sighting.landmark, self._frame_count
        patch.pose[0], patch.disparity[0] = sighting.pose, sighting.disparity
        image = draw(events, sighting.pose, (self._size, self._size), self._kernel)
        patch.template[0], patch.measured[0] = normalized(image), events[-1, 2]
        patch.window[0, len(patch.window[0]) - len(events) :] = events
        judge(patch, 0, self._rotation)
        return patch

    def _recent(self, events: Array) -> Array:
        """Return those of events (N, 3) that are not much older than the newest."""
        if len(events) == 0:
            return events
        return events[events[:, 2] >= events[:, 2].max() - self._config.memory]

    def _observations(self, seen: list[_Sighting]) -> Observations:
        return Observations(
            np.array([s.landmark for s in seen], np.int64),
            np.full(len(seen), self._frame_count - 1),
            np.array([s.pose[:2] for s in seen]).reshape(-1, 2),
            np.array([s.right for s in seen]).reshape(-1, 2),
            np.array([s.times for s in seen]).reshape(-1, 2),
        )


def _columns(image: ClusterEvents) -> Array:
    """Return u, v and time (N, 3) of the rectified events."""
    events = image.events()
    return np.column_stack([events.points, events.t])


def _after(since: float, earlier: Array, later: Array) -> Array:
    """Join two consecutive sets of events (N, 3) and drop those before a time."""
    events = np.concatenate([earlier, later])
    return events[np.searchsorted(events[:, 2], since) :]
