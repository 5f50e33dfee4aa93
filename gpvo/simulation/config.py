"""What is simulated: the room, the motion and the cameras."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from gpvo.config import StageConfig
from gpvo.config.stages.stage import LARGEST_SIDE
from gpvo.recordings import Camera, StereoRig
from gpvo.simulation.motion import SPEEDS, MotionName

Size = Annotated[int, Field(ge=1, le=LARGEST_SIDE)]
"""A width or height, pixels; columns and rows are uint16."""

MOST_PIXELS = 1 << 24
"""Larger than any event camera; more would fill the memory."""


class SimulationConfig(StageConfig):
    """A simulated stereo recording; the default is a handheld camera in a small room."""

    seed: int = Field(default=0, ge=0, description="Seed of the scene, the motion and the sensors.")
    motion: MotionName = Field(default="hand_held", description="How the camera moves.")
    duration: float = Field(
        default=3.0, gt=0, le=3600, description="Duration of the motion, seconds."
    )
    resolution: tuple[Size, Size] = Field(
        default=(346, 260), description="Width and height, pixels."
    )
    focal_length: float = Field(default=226.0, ge=1, le=1e5, description="Of both cameras, pixels.")
    baseline: float = Field(default=0.10, gt=0, description="Distance of the cameras, metres.")
    boxes: int = Field(default=5, ge=0, le=1000, description="Boxes in the room.")
    threshold: float = Field(
        default=0.25,
        ge=0.001,
        description="Change of log intensity that makes an event, both polarities.",
    )
    right_threshold: float | None = Field(
        default=None, ge=0.001, description="That of the right camera; the same if it is null."
    )
    threshold_sigma: float = Field(
        default=0.03, ge=0, description="Standard deviation of the threshold over the pixels."
    )
    refractory_period: float = Field(
        default=0.001, ge=0, description="How long a pixel is silent after an event, seconds."
    )
    noise_rate: float = Field(
        default=0.0, ge=0, le=1e4, description="Random events per pixel and second."
    )
    pixels_per_frame: float = Field(
        default=0.5, ge=0.01, description="Image motion between rendered frames, pixels."
    )

    @field_validator("resolution")
    @classmethod
    def _fit_into_memory(cls, resolution: tuple[int, int]) -> tuple[int, int]:
        if resolution[0] * resolution[1] > MOST_PIXELS:
            raise ValueError(f"more than {MOST_PIXELS} pixels")
        return resolution

    @property
    def rig(self) -> StereoRig:
        """The ideal rig: no distortion, and the right camera along x of the left one."""
        width, height = self.resolution
        centre = ((width - 1) / 2, (height - 1) / 2)
        intrinsics = np.array([self.focal_length, self.focal_length, *centre])
        camera = Camera(self.resolution, intrinsics, "none", np.zeros(4), np.eye(3))
        return StereoRig(camera, camera, self.focal_length, centre, self.baseline)

    @property
    def right(self) -> SimulationConfig:
        """The right camera's, with its own threshold."""
        return self.model_copy(update={"threshold": self.right_threshold or self.threshold})

    @property
    def pixels(self) -> int:
        """Number of pixels of a camera."""
        return self.resolution[0] * self.resolution[1]

    @property
    def room(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest corner (2, 3) of the room and of the part kept clear, metres."""
        half, clear = np.array([3.0, 2.5, 1.5]), np.array([1.3, 1.6, 1.1])
        way = np.zeros(3)
        if self.motion == "corridor":
            half, clear = np.array([3.0, 1.2, 1.2]), np.array([1.5, 0.6, 0.6])
        if self.motion == "driving":
            half, clear = np.array([25.0, 8.0, 3.0]), np.array([4.0, 2.5, 1.5])
        way[0] = SPEEDS.get(self.motion, 0.0) * self.duration
        return np.stack([-half, half + way]), np.stack([-clear, clear + way])
