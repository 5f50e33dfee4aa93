"""Textures that are defined between pixels, and cameras that see one on a plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from shown_events import of_surface

from factors.lie import se3_exp
from factors.stereo import StereoCamera
from gpvo.events import StereoCluster
from gpvo.tracking import Observations
from gpvo.tracking.klt import KltTracker

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

HEIGHT, WIDTH = 180, 240
FRAME = 0.1
"""Seconds between frames."""
CAMERA = StereoCamera(200.0, 200.0, 120.0, 90.0, 0.1)


def track(tracker: KltTracker, left: Image, right: Image) -> Observations:
    """Return the landmarks that are followed into a pair of images, and those new there."""
    return Observations.concatenate([tracker.follow(left, right), tracker.extend()])


@cache
def random_picture(seed: int, shape: tuple[int, int]) -> Image:
    """Return a picture (height, width) of random blobs, a few pixels wide."""
    noise = np.random.default_rng(seed).normal(0, 1, shape)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return np.clip(127 + 45 * smooth / smooth.std(), 0, 255).astype(np.uint8)


class Texture:
    """Random smooth function of the plane, around 0, made of waves of 12 to 40 units."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        angle, length = rng.uniform(0, 2 * np.pi, 40), rng.uniform(12, 40, 40)
        self._waves = 2 * np.pi / length * np.stack([np.cos(angle), np.sin(angle)])
        self._phase = rng.uniform(0, 2 * np.pi, 40)

    def __call__(self, x: Array, y: Array) -> Array:
        angle = np.multiply.outer(x, self._waves[0]) + np.multiply.outer(y, self._waves[1])
        return np.sin(angle + self._phase).sum(axis=-1) / np.sqrt(20)

    def grey(self, dx: float = 0.0, dy: float = 0.0) -> Image:
        """Draw a smooth image of the texture moved by (dx, dy) pixels: bright where near 0."""
        v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
        values = self(u - dx, v - dy)
        return np.rint(255 * np.exp(-((values / 0.4) ** 2))).astype(np.uint8)

    def binary(self, dx: float = 0.0, dy: float = 0.0) -> Image:
        """Draw the image of the texture moved by (dx, dy) pixels: 255 where it is near zero."""
        v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
        return contours(self(u - dx, v - dy))


def contours(values: Array) -> Image:
    return np.where(np.abs(values) < 0.25, 255, 0).astype(np.uint8)


def random_binary(seed: int, size: int = 400) -> Image:
    """Draw an image (size, size) of random white spots, a few pixels wide."""
    noise = np.random.default_rng(seed).normal(size=(size, size))
    return np.where(gaussian_filter(noise, 2.0) > 0.14, 255, 0).astype(np.uint8)


def random_grey(seed: int, size: int = 400) -> Image:
    """Draw an image (size, size) of smooth noise, which looks different everywhere."""
    noise = np.random.default_rng(seed).normal(size=(size, size))
    return np.clip(128 + 400 * gaussian_filter(noise, 2.0), 0, 255).astype(np.uint8)


def window(image: Image, dx: int, dy: int) -> Image:
    """Return a part of a large image whose content appears moved by (dx, dy)."""
    top, left = (image.shape[0] - HEIGHT) // 2, (image.shape[1] - WIDTH) // 2
    return image[top - dy : top - dy + HEIGHT, left - dx : left - dx + WIDTH]


@dataclass(frozen=True, eq=False)
class MovingPlane:
    """Textured plane at Z = `depth` of the world, seen by a camera with constant body twist.

    The texture's unit is the pixel at which the first camera sees it.
    """

    texture: Texture
    twist: Array
    depth: float = 2.0

    def plane_points(self, frame: float, pixels: Array, offset: float = 0.0) -> Array:
        """Compute the world points (N, 3) on the plane that pixels (N, 2) of a camera show.

        `offset` is the camera's position to the right of the left camera, metres.
        """
        T_world_cam = se3_exp(frame * self.twist)
        rays = np.column_stack(
            [
                (pixels[:, 0] - CAMERA.cx) / CAMERA.fx,
                (pixels[:, 1] - CAMERA.cy) / CAMERA.fy,
                np.ones(len(pixels)),
            ]
        )
        rays = rays @ T_world_cam[:3, :3].T
        centre = T_world_cam[:3, 3] + offset * T_world_cam[:3, 0]
        return centre + rays * ((self.depth - centre[2]) / rays[:, 2])[:, None]

    def project(self, frame: float, points: Array) -> Array:
        """Compute the measurements (N, 3) of world points in a frame."""
        T_world_cam = se3_exp(frame * self.twist)
        return CAMERA.project((points - T_world_cam[:3, 3]) @ T_world_cam[:3, :3])

    def images(self, frame: int) -> tuple[Image, Image]:
        """Draw the left and right binary image of a frame."""
        return _images(self, frame)


@cache
def _images(plane: MovingPlane, frame: int) -> tuple[Image, Image]:
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    pixels = np.column_stack([u.ravel(), v.ravel()])
    scale = CAMERA.fx / plane.depth
    shown = []
    for offset in (0.0, CAMERA.baseline):
        points = plane.plane_points(frame, pixels, offset) * scale
        shown.append(contours(plane.texture(points[:, 0], points[:, 1])).reshape(HEIGHT, WIDTH))
    return shown[0], shown[1]


def cluster_of(left: Image, right: Image, start: float = 0.0) -> StereoCluster:
    """Make a cluster with events at `start` where the images are white."""
    surfaces = [np.where(image > 0, start, -np.inf) for image in (left, right)]
    return StereoCluster(start, start + 0.1, *map(of_surface, surfaces))
