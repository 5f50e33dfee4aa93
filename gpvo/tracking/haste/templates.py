"""Patches of events as small images, and their alignment with a template.

A patch pose (u, v, angle), in pixels and radians, maps a patch into the image: x_image = (u, v) +
R(angle) x_patch. Events are (N, 3): u, v and seconds.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

BORDER = 1
"""Pixels around the compared part of a patch, from which its derivatives are computed."""
MOST_STEPS = 10
SMALLEST_STEP = 0.02
"""Length of a step below which the alignment ends, pixels."""
RIDGE = 1e-9
"""Share of the normal matrix's trace added to its diagonal: without texture it is singular."""


def blur_kernel(deviation: float) -> Array:
    """Compute a Gaussian kernel (2 K + 1,) of sum 1, K = ceil(3 deviation)."""
    half = int(np.ceil(3 * deviation))
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / deviation) ** 2)
    return kernel / kernel.sum()


@njit(cache=True)
def draw(events: Array, pose: Array, shape: tuple[int, int], kernel: Array) -> Array:
    """Draw an image (rows, columns) of the events around a pose, blurred by a kernel (2 K + 1,).

    Every event has the weight 1, spread bilinearly. The pose is at the centre of the image.
    """
    half = len(kernel) // 2
    rows, columns = shape[0] + 2 * half, shape[1] + 2 * half
    counts = np.zeros((rows, columns))
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    for i in range(len(events)):
        du, dv = events[i, 0] - pose[0], events[i, 1] - pose[1]
        x = cosine * du + sine * dv + 0.5 * (columns - 1)
        y = -sine * du + cosine * dv + 0.5 * (rows - 1)
        column, row = int(np.floor(x)), int(np.floor(y))
        if 0 <= column < columns - 1 and 0 <= row < rows - 1:
            right, low = x - column, y - row
            counts[row, column] += (1 - right) * (1 - low)
            counts[row, column + 1] += right * (1 - low)
            counts[row + 1, column] += (1 - right) * low
            counts[row + 1, column + 1] += right * low
    return _blurred(counts, kernel)


@njit(cache=True)
def _blurred(image: Array, kernel: Array) -> Array:
    """Convolve an image with the kernel along both axes, where it fits into the image."""
    size = len(kernel)
    rows, columns = image.shape[0] - size + 1, image.shape[1] - size + 1
    across = np.zeros((image.shape[0], columns))
    for k in range(size):
        across += kernel[k] * image[:, k : k + columns]
    blurred = np.zeros((rows, columns))
    for k in range(size):
        blurred += kernel[k] * across[k : k + rows]
    return blurred


@njit(cache=True)
def align(
    events: Array, template: Array, pose: Array, kernel: Array, freedom: int
) -> tuple[Array, float, float]:
    """Find the pose (3,) near a given one at which the events look like the template.

    Least squares after Lucas and Kanade, for any number of events: image = gain (template -
    motion^T gradient) + offset. The motion is along x (freedom 1), also along y (2), and also by
    angle (3). Also returned are the correlation, -1 if there is no solution, and the standard
    deviation of the position, estimated from the residuals, in pixels.
    """
    pose, basis = pose.copy(), _basis(template)[:, : 2 + freedom].copy()
    normal = basis.T @ basis
    inverse = np.linalg.inv(normal + RIDGE * np.trace(normal) * np.eye(len(normal)))
    motion = np.zeros(3)
    for _ in range(MOST_STEPS):
        image = _inner(draw(events, pose, template.shape, kernel))
        fit = inverse @ (basis.T @ image)
        if fit[0] <= 0:
            return pose, -1.0, np.inf
        motion[:freedom] = -fit[2:] / fit[0]
        cosine, sine = np.cos(pose[2]), np.sin(pose[2])
        pose[0] += cosine * motion[0] - sine * motion[1]
        pose[1] += sine * motion[0] + cosine * motion[1]
        pose[2] += motion[2]
        if motion[0] ** 2 + motion[1] ** 2 < SMALLEST_STEP**2:
            break
    image = _inner(draw(events, pose, template.shape, kernel))
    residual = image - basis @ (inverse @ (basis.T @ image))
    variance = (residual @ residual) / (len(residual) * fit[0] ** 2)
    places = inverse[2, 2] + (inverse[3, 3] if freedom > 1 else 0.0)
    return pose, correlation(image, _inner(template)), np.sqrt(variance * places)


@njit(cache=True)
def _inner(image: Array) -> Array:
    return image[BORDER:-BORDER, BORDER:-BORDER].copy().reshape(-1)


@njit(cache=True)
def _basis(template: Array) -> Array:
    """Return the template, 1, and its derivatives with respect to x, y and angle, (pixels, 5)."""
    rows, columns = template.shape[0] - 2 * BORDER, template.shape[1] - 2 * BORDER
    basis = np.empty((rows * columns, 5))
    for row in range(rows):
        for column in range(columns):
            i, r, c = row * columns + column, row + BORDER, column + BORDER
            right = 0.5 * (template[r, c + 1] - template[r, c - 1])
            low = 0.5 * (template[r + 1, c] - template[r - 1, c])
            x, y = column - 0.5 * (columns - 1), row - 0.5 * (rows - 1)
            basis[i] = (template[r, c], 1.0, right, low, x * low - y * right)
    return basis


@njit(cache=True)
def correlation(a: Array, b: Array) -> float:
    """Compute the correlation of two vectors, -1 if either is constant."""
    da, db = a - a.mean(), b - b.mean()
    scale = np.sqrt((da @ da) * (db @ db))
    return (da @ db) / scale if scale > 0 else -1.0


def normalized(image: Array) -> Array:
    """Normalize an image to mean 0 and norm 1, or to 0 if it is constant."""
    centred = image - image.mean()
    norm = np.linalg.norm(centred)
    return centred / norm if norm > 0 else centred
