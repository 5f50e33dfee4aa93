"""What was found of the noise while a run went on, and when it changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpvo.config.stages import NoiseConfig
from gpvo.observer import Step

CHANGE = 0.25
"""Relative change of any value that is worth a line."""


@dataclass(frozen=True)
class FoundNoise:
    """Noise from a time on.

    Attributes
    ----------
    t
        Seconds.
    acceleration_psd
        (6,) diagonal of Q_c.
    measurement_information
        (3,) diagonal of R^-1, pixel^-2.
    background
        Background activity, mean of both cameras, events per pixel and second.
    """

    t: float
    acceleration_psd: tuple[float, ...]
    measurement_information: tuple[float, ...]
    background: float

    def differs_from(self, other: FoundNoise) -> bool:
        """Tell whether a value has changed by more than CHANGE since the other one."""
        mine, others = (
            np.array([*one.acceleration_psd, *one.measurement_information, one.background])
            for one in (self, other)
        )
        return bool((np.abs(mine - others) > CHANGE * np.abs(others)).any())


class NoiseHistory:
    """Observer of the odometry that keeps the changes of the noise, in order of time."""

    def __init__(self) -> None:
        self.changes: list[FoundNoise] = []

    def __call__(self, step: Step) -> None:
        """Take the noise as it is known after a cluster, if the estimator learns it."""
        noise = getattr(step.estimator, "noise", None)
        if not isinstance(noise, NoiseConfig):
            return
        qc, information = noise.acceleration_psd, noise.measurement_information
        now = FoundNoise(step.report.stop, qc, information, step.report.noise_rate)
        if not self.changes or now.differs_from(self.changes[-1]):
            self.changes.append(now)

    @property
    def text(self) -> str:
        """Comments that follow the configuration in its file; empty if nothing was learned."""
        return found_text(self.changes) if self.changes else ""


def found_text(changes: Sequence[FoundNoise]) -> str:
    """Format changes of the noise as comments, a line each."""
    lines = [
        f"# Found while it ran, where a value changed by more than {100 * CHANGE:.0f} %:",
        "# s, acceleration_psd, measurement_information, background events per pixel and s",
    ]
    for one in changes:
        qc, information = (
            "[" + ", ".join(f"{value:.3g}" for value in values) + "]"
            for values in (one.acceleration_psd, one.measurement_information)
        )
        lines.append(f"# {one.t:.3f}  {qc}  {information}  {one.background:.2f}")
    return "\n".join(lines) + "\n"
