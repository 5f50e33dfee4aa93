"""The process that compiles kernels finds the same, bit for bit, as the next that loads them."""

from __future__ import annotations

import dis
import gc
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from front_end_scenes import random_picture
from numba.core.registry import CPUDispatcher
from numpy.typing import NDArray

import gpvo.front_end
import gpvo.odometry  # noqa: F401
from gpvo.tracking.klt.anchors import Anchors, match_anchors, warped_patches
from gpvo.tracking.klt.lucas_kanade import Pyramid
from gpvo.tracking.sights import Sights

SIDE, SHAPE = 31, (160, 200)
KERNELS = [each for each in gc.get_objects() if isinstance(each, CPUDispatcher)]


def called_by(kernel: CPUDispatcher) -> list[CPUDispatcher]:
    function, steps = kernel.py_func, dis.get_instructions(kernel.py_func)
    names = {step.argval for step in steps if step.opname == "LOAD_GLOBAL"}
    called = map(function.__globals__.get, sorted(names))
    return [each for each in called if isinstance(each, CPUDispatcher)]


def sums_in_any_order(kernel: CPUDispatcher) -> bool:
    fast = bool(kernel.targetoptions.get("fastmath"))
    return fast or any(map(sums_in_any_order, called_by(kernel)))


IN_ANY_ORDER = sorted(
    filter(sums_in_any_order, KERNELS), key=lambda kernel: (kernel.__module__, kernel.__name__)
)


@pytest.mark.parametrize("kernel", IN_ANY_ORDER, ids=lambda kernel: kernel.__name__)
def test_kernels_are_inlined_whose_sums_are_in_any_order(kernel: CPUDispatcher) -> None:
    """Else their callers have copies of them with other orders."""
    called = filter(sums_in_any_order, called_by(kernel))
    assert all(each.targetoptions.get("forceinline") for each in called)


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


def test_a_process_that_compiles_finds_the_same_as_the_next(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command, folder = [sys.executable, __file__], Path(__file__).parent
    cold, warm = (
        subprocess.run(command, env=environment, cwd=folder, stdout=subprocess.PIPE, check=True)
        for _ in range(2)
    )
    assert len(cold.stdout.split()) == 3 * 41
    assert cold.stdout == warm.stdout


if __name__ == "__main__":
    for name, values in found():
        print(name, *(value.tobytes().hex() for value in values))
