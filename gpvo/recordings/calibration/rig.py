"""The stereo rig: two lenses, the rectification that aligns them, and rectification tables."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from factors import StereoCamera
from gpvo.errors import InputError, require_choice

DistortionModel = Literal["equidistant", "radtan", "none"]


@dataclass(frozen=True, eq=False)
class Camera:
    """One camera of the rig and how its pixels are rectified.

    Attributes
    ----------
    resolution
        (width, height) in pixels.
    intrinsics
        (4,) fx, fy, cx, cy of the raw image, pixels.
    distortion_model, distortion
        "equidistant" (OpenCV's fisheye, 4 coefficients), "radtan" (4 or 5, in OpenCV's order) or
        "none".
    R_rect
        (3, 3) rotation that takes a point of the raw camera frame to the rectified one.

    Raises
    ------
    InputError
        If there is no such model, or "none" has coefficients.
    """

    resolution: tuple[int, int]
    intrinsics: NDArray[np.float64]
    distortion_model: DistortionModel
    distortion: NDArray[np.float64]
    R_rect: NDArray[np.float64]

    def __post_init__(self) -> None:
        require_choice("distortion_model", self.distortion_model, DistortionModel)
        if self.distortion_model == "none" and np.any(self.distortion):
            raise InputError(
                'distortion: distortion_model "none" has no coefficients; name the model or give'
                " zeros"
            )

    @property
    def K(self) -> NDArray[np.float64]:
        """(3, 3) matrix of the raw intrinsics."""
        fx, fy, cx, cy = self.intrinsics
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def rectify_points(
        self, points: NDArray[np.float64], K_rect: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the rectified pixels (N, 2) of raw pixels (N, 2)."""
        raw = np.ascontiguousarray(points, np.float64).reshape(-1, 1, 2)
        if self.distortion_model == "equidistant":
            rectified = cv2.fisheye.undistortPoints(
                raw, self.K, self.distortion, R=self.R_rect, P=K_rect
            )
        else:
            rectified = cv2.undistortPoints(raw, self.K, self.distortion, R=self.R_rect, P=K_rect)
        return np.asarray(rectified).reshape(-1, 2)

    def rectification_table(self, K_rect: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the rectified pixel (u, v) of every raw pixel, (height, width, 2)."""
        width, height = self.resolution
        rows, columns = np.mgrid[0:height, 0:width]
        pixels = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.float64)
        return self.rectify_points(pixels, K_rect).reshape(height, width, 2).astype(np.float32)


@dataclass(frozen=True, eq=False)
class StereoRig:
    """A rectified stereo pair: both cameras share focal length and principal point.

    A point (X, Y, Z) of the rectified left frame is measured at
    (f X/Z + cx, f Y/Z + cy, f baseline/Z): left column, row and disparity, in pixels.
    """

    left: Camera
    right: Camera
    focal_length: float
    principal_point: tuple[float, float]
    baseline: float

    def camera(self, side: str) -> Camera:
        """Return the left or the right camera."""
        return self.left if side == "left" else self.right

    @property
    def resolution(self) -> tuple[int, int]:
        """(width, height) of the rectified images, the left camera's own."""
        return self.left.resolution

    @property
    def K_rect(self) -> NDArray[np.float64]:
        """(3, 3) intrinsics of both rectified cameras."""
        f, (cx, cy) = self.focal_length, self.principal_point
        return np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])

    @property
    def stereo_camera(self) -> StereoCamera:
        """Intrinsics of the rectified pair, as the factors take them."""
        f = self.focal_length
        return StereoCamera(f, f, *self.principal_point, self.baseline)

    @cached_property
    def tables(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Rectification tables of the left and right camera, computed once."""
        return (
            self.left.rectification_table(self.K_rect),
            self.right.rectification_table(self.K_rect),
        )
