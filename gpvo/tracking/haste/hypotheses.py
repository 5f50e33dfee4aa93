"""Hypotheses on the motion of a patch, scored event by event.

HASTE (Alzugaray and Chli, BMVC 2020), the correlation variant: the latest events of a patch are
compared with its template at the present pose, and at poses a pixel or an angle away. The patch
moves to another pose as soon as an event makes that pose the more likely one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Patches(NamedTuple):
    """Tracked patches: M patches with N latest events each, under H hypotheses.

    Attributes
    ----------
    landmark
        (M,) int64 identity.
    frame
        (M,) int64 number of the cluster in which it was measured last.
    measured
        (M,) time of the newest event of the last measurement, seconds.
    pose
        (M, 3) u, v and angle, pixels and radians.
    disparity
        (M,) disparity of the last measurement, pixels.
    template
        (M, S, S) appearance of the patch.
    window
        (M, N, 3) u, v and time of the latest events, the oldest overwritten first.
    oldest
        (M,) index in the window of the oldest event.
    likeness
        (M, N, H) score of every hypothesis by every event of the window.
    score
        (M, H) sum of the likeness over the window.
    moved
        (M,) whether the pose changed since this flag was last cleared.
    moving
        (M, N, 3) the window at the event that last changed the pose.
    """

    landmark: NDArray[np.int64]
    frame: NDArray[np.int64]
    measured: Array
    pose: Array
    disparity: Array
    template: Array
    window: Array
    oldest: NDArray[np.int64]
    likeness: Array
    score: Array
    moved: NDArray[np.bool_]
    moving: Array

    def select(self, mask: NDArray[np.bool_]) -> Patches:
        """Return the patches where the mask (M,) is True."""
        return Patches._make(column[mask] for column in self)

    @staticmethod
    def concatenate(parts: Sequence[Patches]) -> Patches:
        """Join several sets of patches."""
        return Patches._make(np.concatenate(column) for column in zip(*parts, strict=True))


HYPOTHESES = 11
"""Number of hypotheses: shifts by -1, 0 or 1 pixel along both axes (9), both rotations (2)."""
STAY = 4


def new_patches(size: int, window: int, count: int = 0) -> Patches:
    """Make blank patches of side `size` whose `window` events are infinitely far away."""
    return Patches(
        np.zeros(count, np.int64),
        np.zeros(count, np.int64),
        np.zeros(count),
        np.zeros((count, 3)),
        np.zeros(count),
        np.zeros((count, size, size)),
        np.full((count, window, 3), -np.inf),
        np.zeros(count, np.int64),
        np.zeros((count, window, HYPOTHESES)),
        np.zeros((count, HYPOTHESES)),
        np.zeros(count, bool),
        np.full((count, window, 3), -np.inf),
    )


@njit(cache=True)
def follow(events: Array, patches: Patches, rotation: float, reach: float, margin: float) -> None:
    """Update patches in place by events (E, 3), one by one.

    An event counts for the patches whose centre is within `reach` pixels along both axes. With the
    present score s, a hypothesis wins when its score exceeds s by more than margin |s|; s is
    negative for a lost patch. `rotation` is the angle of the two rotations, radians.
    """
    for i in range(len(events)):
        for k in range(len(patches.pose)):
            near = abs(events[i, 0] - patches.pose[k, 0]) <= reach
            if near and abs(events[i, 1] - patches.pose[k, 1]) <= reach:
                _take(events[i], patches, k, rotation)
                best, present = np.argmax(patches.score[k]), patches.score[k, STAY]
                if patches.score[k, best] - present > margin * abs(present):
                    move(patches.pose[k], best, rotation)
                    patches.moved[k] = True
                    patches.moving[k] = patches.window[k]
                    judge(patches, k, rotation)


@njit(cache=True)
def move(pose: Array, hypothesis: int, rotation: float) -> None:
    """Move a pose (3,) by a hypothesis, in place; steps are along the axes of the patch."""
    if hypothesis < 9:
        right, low = hypothesis % 3 - 1, hypothesis // 3 - 1
        cosine, sine = np.cos(pose[2]), np.sin(pose[2])
        pose[0] += cosine * right - sine * low
        pose[1] += sine * right + cosine * low
    else:
        pose[2] += rotation if hypothesis == 9 else -rotation


@njit(cache=True)
def _take(event: Array, patches: Patches, k: int, rotation: float) -> None:
    """Replace the oldest event of patch k and update its scores."""
    place = patches.oldest[k]
    patches.oldest[k] = (place + 1) % patches.window.shape[1]
    patches.window[k, place] = event
    patches.score[k] -= patches.likeness[k, place]
    _judge_event(event, patches.template[k], patches.pose[k], rotation, patches.likeness[k, place])
    patches.score[k] += patches.likeness[k, place]


@njit(cache=True)
def judge(patches: Patches, k: int, rotation: float) -> None:
    """Compute the scores of all hypotheses of patch k again from the whole window."""
    template, pose, likeness = patches.template[k], patches.pose[k], patches.likeness[k]
    patches.score[k] = 0.0
    for place in range(len(likeness)):
        _judge_event(patches.window[k, place], template, pose, rotation, likeness[place])
        patches.score[k] += likeness[place]


@njit(cache=True)
def _judge_event(
    event: Array, template: Array, pose: Array, rotation: float, likeness: Array
) -> None:
    """Write the template's brightness under an event for every hypothesis (11,), bilinear.

    An event for which a hypothesis lies outside the template contributes 0 to all of them.
    """
    centre = 0.5 * (len(template) - 1)
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    du, dv = event[0] - pose[0], event[1] - pose[1]
    x, y = cosine * du + sine * dv, -sine * du + cosine * dv
    likeness[:] = 0.0
    if not (abs(x) < centre - 1 and abs(y) < centre - 1):  # or a blank event, at infinity
        return
    turn_x, turn_y = np.cos(rotation), np.sin(rotation)
    _bilinear_around(template, x + centre, y + centre, likeness)
    likeness[9] = _bilinear(
        template, turn_x * x + turn_y * y + centre, turn_x * y - turn_y * x + centre
    )
    likeness[10] = _bilinear(
        template, turn_x * x - turn_y * y + centre, turn_x * y + turn_y * x + centre
    )


@njit(cache=True)
def _bilinear_around(image: Array, x: float, y: float, values: Array) -> None:
    """Write the brightness at 3 x 3 points a pixel apart, from the lower right to the upper left.

    The order is reversed because a step of the patch to the left is equivalent to a step of its
    events to the right.
    """
    column, row = int(np.floor(x)), int(np.floor(y))
    right, low = x - column, y - row
    for i in range(3):
        above, below = image[row + 1 - i], image[row + 2 - i]
        for j in range(3):
            c = column + 1 - j
            top = above[c] + right * (above[c + 1] - above[c])
            bottom = below[c] + right * (below[c + 1] - below[c])
            values[3 * i + j] = top + low * (bottom - top)


@njit(cache=True)
def _bilinear(image: Array, x: float, y: float) -> float:
    """Interpolate the brightness between pixels; it is 0 outside the image."""
    column, row = int(np.floor(x)), int(np.floor(y))
    if not (0 <= column < image.shape[1] - 1 and 0 <= row < image.shape[0] - 1):
        return 0.0
    right, low = x - column, y - row
    top = image[row, column] + right * (image[row, column + 1] - image[row, column])
    bottom = image[row + 1, column] + right * (image[row + 1, column + 1] - image[row + 1, column])
    return top + low * (bottom - top)
