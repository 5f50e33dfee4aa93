"""Patches of landmarks at their first good sight, matched again under the warp of the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.array_table import ArrayTable
from gpvo.second_thread import in_halves
from gpvo.tracking.klt.anchor_kernels import (
    cut_patches_kernel,
    match_anchors_kernel,
    warp_patches_kernel,
)
from gpvo.tracking.klt.lucas_kanade import BEYOND, Pyramid
from gpvo.tracking.sights import Sights

Array = NDArray[np.float64]
Points = NDArray[np.float32]

ROOM = 1.8
"""Half side of a kept patch, in half sides of what is matched: to be turned and made smaller."""


@dataclass(frozen=True, eq=False)
class Anchors(ArrayTable):
    """Where and how N landmarks were seen first.

    Attributes
    ----------
    patch
        (N, side, side) uint8 image around the landmark's pixel.
    sights
        Where they were seen.
    """

    patch: NDArray[np.uint8]
    sights: Sights

    @classmethod
    def of_image(cls, image: Pyramid, sights: Sights) -> Anchors:
        """Keep the image around landmarks that were seen in it."""
        half = int(ROOM * (image.patch_size // 2)) + 1
        border = image.patch_size + BEYOND
        pixels = _pixels(sights.point)
        return cls(cut_patches_kernel(image.levels[0], pixels, border, half), sights)


def match_anchors(
    anchors: Anchors, warps: Array, image: Pyramid, guess: Points
) -> tuple[Points, Array]:
    """Match anchors under their warps (N, 3, 2) with an image, from a guess (N, 2) on.

    Brightness and contrast may differ: event images of slow motion have fewer events. Returns the
    points in the image (N, 2), and the correlation (N,) of the warped patches with the image there,
    -1 for those that are not found.
    """
    place, ends = places(anchors), guess.astype(np.float32)
    alike, searched = np.full(len(guess), -1.0), np.ones(len(guess), np.bool_)

    def match(part: slice) -> None:
        match_anchors_kernel(
            anchors.patch[part],
            place[part],
            warps[part],
            image.levels[0],
            image.patch_size,
            ends[part],
            alike[part],
            searched[part],
        )

    in_halves(match, len(guess))
    return ends, alike


def warped_patches(anchors: Anchors, warps: Array, side: int) -> NDArray[np.float32]:
    """Return the patches (N, side, side) of anchors under their warps (N, 3, 2)."""
    return warp_patches_kernel(anchors.patch, places(anchors), warps, side)


def places(anchors: Anchors) -> Array:
    """Return where landmarks (N, 2) are in their patches, pixels from the first one."""
    point = anchors.sights.point
    return point - _pixels(point) + anchors.patch.shape[1] // 2


def _pixels(points: NDArray[np.floating]) -> NDArray[np.int64]:
    """Return the pixels (N, 2) in which points (N, 2) are."""
    return np.rint(points).astype(np.int64)
