"""Landmarks followed from a stereo frame to the next: around the quad, then by their anchors.

The quad of section III-A.2 is previous left, current left, current right, previous right and back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpvo.config.stages import KltConfig
from gpvo.second_thread import in_halves
from gpvo.tracking.klt.anchor_kernels import match_anchors_kernel
from gpvo.tracking.klt.anchors import places
from gpvo.tracking.klt.frame import Frame
from gpvo.tracking.klt.lucas_kanade import Pairs, match_levels, pairs_of_levels
from gpvo.tracking.klt.patch_checks import Image, check_kernel, limits_of

Array = NDArray[np.float64]
Points = NDArray[np.float32]
StereoPoints = tuple[Points, Points]
Quad = tuple[Pairs, Pairs, Pairs, Pairs]
Mask = NDArray[np.bool_]
Marks = NDArray[np.uint8]

LOST, KNOWN, CHANGED = 0, 1, 2
"""A landmark is not found, found by its anchor, or found while it looks unlike its anchor."""
FINE = 1
"""Coarser levels for landmarks that are expected within a pixel or two."""


def follow(
    previous: Frame,
    frame: Frame,
    ahead: StereoPoints,
    warps: Array,
    config: KltConfig,
    closure_tolerance: float,
) -> tuple[Points, Points, Marks]:
    """Match the landmarks of the previous frame with a frame, from where they may be now (N, 2).

    In time patches are searched from the coarsest level on, there and back: what is ambiguous among
    noise then does not come back. A landmark that the quad leads back is matched with its anchor
    under its warp (3, 2), so that errors of the matches do not add up; that match takes the place
    of the one with the previous frame, unless the landmark looks unlike its anchor. It is lost if
    the two are far apart. The disparity stays: it hardly differs a fraction of a pixel beside.
    Returns the left and right points (N, 2) and marks (N,).
    """
    left, right = ahead[0].copy(), ahead[1].copy()
    marks = np.full(len(left), LOST, np.uint8)
    images = frame.left_image.image, frame.right_image.image
    coarsest = frame.left_image.coarsest, min(FINE, frame.left_image.coarsest)
    given = _quad(previous, frame), coarsest, images, previous.left_image.patch_size
    place = places(previous.anchors)

    def follow_part(part: slice) -> None:
        before = previous.left[part], previous.right[part]
        anchors = previous.anchors.patch[part], place[part], warps[part]
        ends = left[part], right[part], marks[part]
        _follow_part(*given, config, closure_tolerance, before, anchors, *ends)

    in_halves(follow_part, len(left))
    return left, right, marks


def _quad(previous: Frame, frame: Frame) -> Quad:
    """Return the levels of each match of the quad."""
    before, now = (one.images for one in (previous, frame))
    corners = before[0], now[0], now[1], before[1]
    first, second, third, last = map(pairs_of_levels, corners, (*corners[1:], corners[0]))
    return first, second, third, last


def _follow_part(
    quad: Quad,
    coarsest: tuple[int, int],
    images: tuple[Image, Image],
    side: int,
    config: KltConfig,
    closure_tolerance: float,
    before: StereoPoints,
    anchors: tuple[NDArray[np.uint8], Array, Array],
    left: Points,
    right: Points,
    marks: Marks,
) -> None:
    """Refine the left and right points (N, 2), and mark (N,) those that are found."""
    passed = _around_quad(quad, coarsest, side, before, left, right, closure_tolerance)
    check_kernel(images, left, right, limits_of(config), passed)
    ends, alike = left.copy(), np.full(len(left), -1.0)
    match_anchors_kernel(*anchors, quad[0][0][1], side, ends, alike, passed)
    marks[passed & (alike < config.anchor_correlation)] = CHANGED
    passed &= alike >= config.anchor_correlation
    moved = (ends - left) * passed[:, None]
    left += moved
    right += moved
    passed &= _lengths(moved) < config.anchor_tolerance
    check_kernel(images, left, right, limits_of(config), passed)
    marks[passed] = KNOWN


def _around_quad(
    quad: Quad,
    coarsest: tuple[int, int],
    side: int,
    before: StereoPoints,
    left: Points,
    right: Points,
    tolerance: float,
) -> Mask:
    """Match points (N, 2) around the quad; return which end near their start.

    `coarsest` are the levels to begin with between frames, and between left and right.
    """
    found, shift = np.zeros((4, len(left)), np.bool_), left - right
    match_levels(quad[0], coarsest[0], side, before[0], left, found[0])
    right[:] = left - shift
    match_levels(quad[1], coarsest[1], side, left, right, found[1])
    back = right.copy()
    match_levels(quad[2], coarsest[0], side, right, back, found[2])
    end = back - (before[1] - before[0])
    match_levels(quad[3], coarsest[1], side, back, end, found[3])
    return np.asarray(found.all(axis=0) & (_lengths(end - before[0]) < tolerance))


def _lengths(ways: Points) -> Points:
    """Return the lengths (N,) of ways (N, 2)."""
    return np.asarray(np.hypot(ways[:, 0], ways[:, 1]))
