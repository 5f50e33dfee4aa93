"""Periodic random textures with corners at many scales, blurred to several levels of detail."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

TEXELS = 512
"""Period of a texture; a power of two, so that wrapping a coordinate is a bit mask."""

LEVELS = 5
"""Levels of detail; level k suits pixels that cover 2**k texels."""

_SHAPES = ((80, 40.0, 80.0), (100, 15.0, 40.0), (300, 4.0, 12.0))
"""Shapes painted on a texture, coarse below fine: number, smallest and largest radius in texels."""

_CONTRAST = 1.8
"""Range of the shapes' log intensity, about a factor of six in brightness."""

_NOISE = 0.04
"""Standard deviation of the log intensity of the band-limited noise on top."""


def random_textures(number: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw log intensities (number, LEVELS, TEXELS, TEXELS), periodic in rows and columns."""
    return np.stack([_levels_of_detail(_random_texture(rng)) for _ in range(number)])


def _random_texture(rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw polygons and discs of random brightness, and noise between two wavelengths."""
    image = np.full((TEXELS, TEXELS), 128, np.uint8)
    for number, smallest, largest in _SHAPES:
        for radius in rng.uniform(smallest, largest, number):
            _paint_shape(image, radius, rng)
    shapes = _CONTRAST * (image.astype(np.float32) / 255.0 - 0.5)
    white = rng.standard_normal(shapes.shape, np.float32)
    spectrum = scipy.fft.rfft2(white)
    noise = _blurred(spectrum, 2.0) - _blurred(spectrum, 10.0)
    return shapes + _NOISE / noise.std() * noise


def _paint_shape(image: NDArray[np.uint8], radius: float, rng: np.random.Generator) -> None:
    """Paint a disc, triangle, quadrangle or pentagon."""
    centre = rng.uniform(0, TEXELS, 2)
    brightness = int(rng.integers(256))
    corners = int(rng.integers(2, 6))
    if corners == 2:
        cv2.circle(image, centre.astype(int).tolist(), round(radius), brightness, cv2.FILLED)
        return
    turns = (np.arange(corners) + rng.uniform(-0.3, 0.3, corners)) / corners + rng.uniform()
    around = np.stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)], axis=1)
    cv2.fillConvexPoly(image, np.rint(centre + radius * around).astype(np.int32), brightness)


def _levels_of_detail(texture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (LEVELS, TEXELS, TEXELS), each level blurred by 0.6 of the pixel size it suits."""
    spectrum = scipy.fft.rfft2(texture)
    return np.stack([_blurred(spectrum, 0.6 * 2**level) for level in range(LEVELS)])


def _blurred(spectrum: NDArray[np.complex64], sigma: float) -> NDArray[np.float32]:
    """Return an image of its spectrum, blurred by a Gaussian of sigma texels that wraps around."""
    return scipy.fft.irfft2(spectrum * _gain(sigma), s=(TEXELS, TEXELS))


@cache
def _gain(sigma: float) -> NDArray[np.float32]:
    """Return the spectrum of a Gaussian of sigma texels."""
    rows = np.fft.fftfreq(TEXELS).astype(np.float32)[:, None]
    columns = np.fft.rfftfreq(TEXELS).astype(np.float32)
    gain = np.exp(-2.0 * (np.pi * sigma) ** 2 * (rows**2 + columns**2))
    return np.asarray(gain, np.float32)
