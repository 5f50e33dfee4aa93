"""Patches of landmarks at their first good sight, matched again under the warp of the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.array_table import ArrayTable
from gpvo.second_thread import in_halves
from gpvo.tracking.klt.anchor_kernels import cut_patches_kernel, match_anchors_kernel
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
        (N, side, side) float32 image around the landmark.
    sights
        Where they were seen.
    """

    patch: NDArray[np.float32]
    sights: Sights

    @classmethod
    def of_image(cls, image: Pyramid, points: Points, sights: Sights) -> Anchors:
        """Keep the image around the points (N, 2) of a frame."""
        half = int(ROOM * (image.patch_size // 2)) + 1
        patch = cut_patches_kernel(image.levels[0], points, image.patch_size + BEYOND, half)
        return cls(patch, sights)


def match_anchors(
    anchors: Anchors, warps: Array, image: Pyramid, guess: Points
) -> tuple[Points, Array]:
    """Match anchors under their warps (N, 2, 2) with an image, from a guess (N, 2) on.

    Brightness and contrast may differ: event images of slow motion have fewer events. Returns the
    points in the image (N, 2), and the correlation (N,) of the warped patches with the image there,
    -1 for those that are not found.
    """
    ends, alike = guess.astype(np.float32), np.full(len(guess), -1.0)
    inverse = np.linalg.inv(warps)

    def match(part: slice) -> None:
        match_anchors_kernel(
            anchors.patch[part],
            inverse[part],
            image.levels[0],
            image.patch_size,
            ends[part],
            alike[part],
        )

    in_halves(match, len(guess))
    return ends, alike
