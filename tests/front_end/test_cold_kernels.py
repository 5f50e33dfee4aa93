"""The process that compiles kernels finds the same, bit for bit, as the next that loads them."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from front_end_scenes import random_picture
from numpy.typing import NDArray

from gpvo.config.stages import KltConfig
from gpvo.tracking.klt.anchors import Anchors, match_anchors, warped_patches
from gpvo.tracking.klt.lucas_kanade import Pyramid, match_patches
from gpvo.tracking.klt.match_precision import match_variances
from gpvo.tracking.klt.patch_checks import are_stereo
from gpvo.tracking.klt.row_search import search_rows
from gpvo.tracking.sights import Sights

SIDE, SHAPE = 31, (160, 200)


def found() -> Iterator[tuple[str, NDArray[np.generic]]]:
    """Find what all kernels of patches find in two pictures, of which one is moved."""
    rng, pictures = np.random.default_rng(7), random_picture(7, (SHAPE[0], SHAPE[1] + 8))
    images = pictures[:, :-8].copy(), pictures[:, 8:].copy()
    left, right = (Pyramid.of_image(image, SIDE, 1) for image in images)
    points = rng.uniform(40, 120, (40, 2)).astype(np.float32)
    guess = points - np.float32([8, 0]) + rng.uniform(-0.5, 0.5, (40, 2)).astype(np.float32)
    anchors = Anchors.of_image(left, Sights.of_frame(points, guess, np.eye(4)))
    warps = np.array([[1, 0], [0, 1], [0, 0]]) + rng.uniform(-2e-3, 2e-3, (40, 3, 2))
    yield "warped", warped_patches(anchors, warps, SIDE)
    yield from zip(("anchors", "alike"), match_anchors(anchors, warps, right, guess), strict=True)
    yield "patches", match_patches(left, right, points, guess, 1)[0]
    yield "variances", match_variances(left, right, points, guess)
    yield "rows", search_rows(left, right, points)[0]
    yield "stereo", are_stereo(images, points, guess, KltConfig(min_correlation=0.99))


def test_a_process_that_compiles_finds_the_same_as_the_next(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command, folder = [sys.executable, __file__], Path(__file__).parent
    cold, warm = (
        subprocess.run(command, env=environment, cwd=folder, stdout=subprocess.PIPE, check=True)
        for _ in range(2)
    )
    assert len(cold.stdout.split()) == 7 * 41
    assert cold.stdout == warm.stdout


if __name__ == "__main__":
    for name, values in found():
        print(name, *(value.tobytes().hex() for value in values))
