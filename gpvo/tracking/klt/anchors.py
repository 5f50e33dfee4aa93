"""Patches of landmarks at their first good sight, matched again under the warp of the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpvo.array_table import ArrayTable
from gpvo.second_thread import in_halves
from gpvo.tracking.klt.anchor_kernels import cut_patches_kernel, match_anchors_kernel
from gpvo.tracking.klt.lucas_kanade import BEYOND, Pyramid

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
    point
        (N, 2) pixel of the landmark.
    disparity
        (N,) pixels.
    T_start_cam
        (N, 4, 4) pose of that frame.
    """

    patch: NDArray[np.float32]
    point: Array
    disparity: Array
    T_start_cam: Array

    @classmethod
    def of_frame(
        cls, image: Pyramid, points: Points, disparity: NDArray[np.float32], T_start_cam: Array
    ) -> Anchors:
        """Keep the image around the points (N, 2) of a frame."""
        half = int(ROOM * (image.patch_size // 2)) + 1
        patch = cut_patches_kernel(image.levels[0], points, image.patch_size + BEYOND, half)
        poses = np.repeat(T_start_cam[None], len(points), axis=0)
        return cls(patch, points.astype(np.float64), disparity.astype(np.float64), poses)


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
