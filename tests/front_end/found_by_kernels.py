"""A program that prints what kernels find that call the same ones, for `test_cold_kernels`."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import numpy as np
from front_end_scenes import random_picture
from numpy.typing import NDArray

from gpvo.tracking.klt.anchors import Anchors, match_anchors, warped_patches
from gpvo.tracking.klt.lucas_kanade import Pyramid
from gpvo.tracking.sights import Sights

SIDE, SHAPE = 31, (160, 200)


def found() -> Iterator[tuple[str, NDArray[np.generic]]]:
    """Find what kernels find that call the same ones, in two pictures of which one is moved."""
    rng, pictures = np.random.default_rng(7), random_picture(7, (SHAPE[0], SHAPE[1] + 8))
    images = pictures[:, :-8].copy(), pictures[:, 8:].copy()
    left, right = (Pyramid.of_image(image, SIDE, 1) for image in images)
    points = rng.uniform(40, 120, (40, 2)).astype(np.float32)
    guess = points - np.float32([8, 0]) + rng.uniform(-0.5, 0.5, (40, 2)).astype(np.float32)
    anchors = Anchors.of_image(left, Sights.of_frame(points, guess, np.eye(4)))
    warps = np.array([[1, 0], [0, 1], [0, 0]]) + rng.uniform(-2e-3, 2e-3, (40, 3, 2))
    yield "warped", warped_patches(anchors, warps, SIDE)
    yield from zip(("anchors", "alike"), match_anchors(anchors, warps, right, guess), strict=True)


if __name__ == "__main__":
    gc.disable()  # as where kernels are compiled beside a run
    for name, values in found():
        print(name, *(value.tobytes().hex() for value in values))
