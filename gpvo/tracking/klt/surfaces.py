"""Slopes of the surfaces that landmarks are on, by how patches differ between left and right.

On a plane the disparity is linear, d + g . dp at a pixel dp beside a landmark: the right patch is
stretched and sheared. If its slope g is not known, a patch of a wall at an angle is matched as if
it faced the camera, where most of its contours fit. These are beside the landmark: its disparity is
theirs, and as the camera moves they come and go, and move otherwise than it does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import fast_kernel, inner_kernel, kernel
from gpvo.second_thread import in_halves
from gpvo.tracking.klt.lucas_kanade import BEYOND, Pyramid, inside, touches
from gpvo.tracking.klt.patch_kernels import (
    Level,
    Row,
    centre,
    clear_outside,
    dot,
    relative_contrast,
    sample_gradients,
)

Array = NDArray[np.float64]
Points = NDArray[np.float32]

SLANT = 1.0
"""Usual slant of a surface: the tangent of its angle to one that faces the camera."""
ALIKE = 20.0
"""Number of pixels of a picture that share their noise."""
LEAST_NOISE = 2.0
"""Standard deviation of a pixel of patches that are alike, grey levels."""
LEAST_DISPARITY = 0.5
"""Disparity of what is very far, pixels."""
LARGEST_SHIFT = 4.0
"""Distance, pixels, beyond which another match is found than the one that was refined."""
STEPS = 8
"""Most Gauss-Newton steps."""
ACCURACY = 0.01
"""Length of a step at which a match has converged, pixels at the patch's border."""


def fit_surfaces(
    left_image: Pyramid, right_image: Pyramid, left: Points, right: Points, focal_length: float
) -> tuple[Points, Array]:
    """Refine right points (N, 2) together with the slopes (N, 2) of the surfaces; return both.

    A slant t makes a slope t d / f. How much is usual is known by SLANT; what the patches tell
    counts by their gradients, and by how alike they are.
    """
    disparity = np.maximum(left[:, 0] - right[:, 0], LEAST_DISPARITY).astype(np.float64)
    right, slopes = right.copy(), np.zeros((len(left), 2))
    _match(left_image, right_image, left, SLANT / focal_length * disparity, slopes, right)
    return right, slopes


def match_on_surfaces(
    left_image: Pyramid, right_image: Pyramid, left: Points, right: Points, slopes: Array
) -> Points:
    """Refine right points (N, 2) of left ones on surfaces with known slopes (N, 2); return them."""
    right = right.copy()
    _match(left_image, right_image, left, np.zeros(len(left)), slopes.copy(), right)
    return right


def _match(
    left_image: Pyramid,
    right_image: Pyramid,
    left: Points,
    spread: Array,
    slopes: Array,
    right: Points,
) -> None:
    """Refine right points (N, 2), and slopes (N, 2) where they have a spread (N,)."""
    images = left_image.levels[0], right_image.levels[0], left_image.patch_size

    def match(part: slice) -> None:
        match_surfaces_kernel(*images, left[part], spread[part], slopes[part], right[part])

    in_halves(match, len(left))


@kernel
def match_surfaces_kernel(
    left: Level,
    right: Level,
    side: int,
    points: Points,
    spread: Array,
    slopes: Array,
    matches: Points,
) -> None:
    """Refine slopes (N, 2), if they have a spread (N,), and the columns of matches (N, 2).

    Those whose patch is beyond an image, or that move far, stay as they are.
    """
    width = side + 3  # of the rows of all patches, which are stored one after the other
    size = (side + 3) * width + 2
    window, samples = np.zeros(size, np.float32), np.zeros(size, np.float32)
    parts, down = np.zeros((5, side * width), np.float32), np.zeros(side * width, np.float32)
    corner = side + BEYOND - side // 2  # from the centre of a patch to its first pixel
    for n in range(len(points)):
        u, v = points[n, 0] + corner, points[n, 1] + corner
        x, y = matches[n, 0] + corner, matches[n, 1] + corner
        if touches(left, side, u, v) and touches(right, side, x, y):
            sample_gradients(left, u, v, side, width, window, samples, parts[1], down)
            columns, other = inside(u, left.shape[1], side), inside(x, right.shape[1], side)
            both = max(columns[0], other[0]), min(columns[1], other[1])
            clear_outside(both, inside(v, left.shape[0], side), width, parts[1], down)
            centre(samples[width + 1 :], side, width, parts[0])
            shift, across, along = _fit(right, (x, y), side, parts, spread[n], slopes[n])
            if abs(shift) < LARGEST_SHIFT:
                matches[n, 0] -= np.float32(shift)
                slopes[n, 0], slopes[n, 1] = across, along


@inner_kernel
def _fit(
    right: Level, start: tuple[float, float], side: int, parts: Row, spread: float, slope: Row
) -> tuple[float, float, float]:
    """Return what to add to the disparity of a match, and the slope, by Gauss-Newton.

    `parts` are the left patch, its gradient along the row, room for that times the pixels' columns
    and rows, and room for the right patch. The shift is eliminated from the slope's equations.
    """
    patch, q, q_u, q_v, seen = parts[0], parts[1], parts[2], parts[3], parts[4]
    s, s_u, s_v, squares = max(dot(q, q), 1e-9), 0.0, 0.0, (0.0, 0.0, 0.0)
    if spread > 0:
        _moments(q, side, side + 3, q_u, q_v)
        s_u, s_v, uv = dot(q, q_u), dot(q, q_v), dot(q_u, q_v)
        squares = dot(q_u, q_u) - s_u**2 / s, uv - s_u * s_v / s, dot(q_v, q_v) - s_v**2 / s
    shift, g_u, g_v = 0.0, float(slope[0]), float(slope[1])
    for _ in range(STEPS):
        sample_sloped(right, start[0] - shift, start[1], g_u, g_v, side, side + 3, seen)
        gain = _remove(patch, side, seen)
        step, d_u, d_v = dot(q, seen) / gain / s, 0.0, 0.0
        if spread > 0:
            noise = dot(seen, seen) / (side * side) + LEAST_NOISE**2
            prior = ALIKE * noise / (gain * spread) ** 2
            e_u, e_v = dot(q_u, seen) / gain - s_u * step, dot(q_v, seen) / gain - s_v * step
            d_u, d_v = _solved(squares, prior, (e_u - prior * g_u, e_v - prior * g_v))
            step -= (s_u * d_u + s_v * d_v) / s
        shift, g_u, g_v = shift + step, g_u + d_u, g_v + d_v
        if abs(step) + side * (abs(d_u) + abs(d_v)) < ACCURACY or not abs(shift) < LARGEST_SHIFT:
            break
    return shift, g_u, g_v


@inner_kernel
def _solved(
    squares: tuple[float, float, float], prior: float, errors: tuple[float, float]
) -> tuple[float, float]:
    """Solve two equations with a symmetric matrix, whose diagonal a prior adds to."""
    uu, uv, vv = squares[0] + prior, squares[1], squares[2] + prior
    determinant = uu * vv - uv * uv
    return (
        (vv * errors[0] - uv * errors[1]) / determinant,
        (uu * errors[1] - uv * errors[0]) / determinant,
    )


@inner_kernel
def _remove(patch: Row, side: int, seen: Row) -> float:
    """Leave of another patch what it differs by, whatever its brightness; return its contrast."""
    centre(seen, side, side + 3, seen)
    gain = relative_contrast(patch, seen)
    _subtract(patch, gain, seen)
    return gain


@fast_kernel
def _moments(gradient: Row, side: int, width: int, by_column: Row, by_row: Row) -> None:
    """Multiply a gradient by its pixels' columns and rows, from the patch's middle on."""
    half = side // 2
    for row in range(side):
        for column in range(width):
            k = row * width + column
            by_column[k] = gradient[k] * np.float32(column - half)
            by_row[k] = gradient[k] * np.float32(row - half)


@fast_kernel
def sample_sloped(
    image: Level, u: float, v: float, g_u: float, g_v: float, side: int, width: int, seen: Row
) -> None:
    """Sample the right patch on a surface with a slope; without it its first pixel is at (u, v)."""
    half, last = side // 2, np.float32(image.shape[1] - 2)
    top, low = int(np.floor(v)), np.float32(v - np.floor(v))
    stretch, start = np.float32(1 - g_u), np.empty(side, np.int32)
    share = np.empty(side, np.float32)
    for row in range(side):
        upper, lower, line = image[top + row], image[top + row + 1], seen[row * width :]
        first = np.float32(u + half * g_u - g_v * (row - half))
        for k in range(side):
            x = min(max(first + stretch * np.float32(np.int32(k)), np.float32(0)), last)
            start[k] = np.int32(x)
            share[k] = x - np.float32(np.int32(x))
        for k in range(side):
            i = np.uint64(start[k])  # no negative indices
            j = i + np.uint64(1)
            a = np.float32(upper[i]) + share[k] * (np.float32(upper[j]) - np.float32(upper[i]))
            b = np.float32(lower[i]) + share[k] * (np.float32(lower[j]) - np.float32(lower[i]))
            line[k] = a + low * (b - a)


@fast_kernel
def _subtract(patch: Row, gain: float, seen: Row) -> None:
    """Subtract a patch with a gain from another."""
    factor = np.float32(gain)
    for k in range(len(patch)):
        seen[k] -= factor * patch[k]
