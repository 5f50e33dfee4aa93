"""What is known of landmarks from before a window, and what it is worth when they are seen anew."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors import LandmarkPrior
from factors.structureless.identities import are_in, increasing
from gpvo.config.stages import NoiseConfig
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.landmark_looks import Looks
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class KnownLandmarks:
    """Landmarks that were measured before a window.

    Attributes
    ----------
    prior
        What is known of them, given the window's first state.
    lost
        Identities of those that are remembered though they are not measured any more, the one that
        was measured longest ago first.
    looks
        How they looked when they were measured last.
    """

    prior: LandmarkPrior
    lost: Index
    looks: Looks

    @classmethod
    def none(cls) -> KnownLandmarks:
        """Return that no landmark is known."""
        return cls(LandmarkPrior.none(), np.empty(0, np.int64), Looks.none())

    def seen_again(self, landmark: Index, states: States, build: GraphBuilder) -> KnownLandmarks:
        """Return what is known after some lost ones are measured again, in a window of states.

        They may look otherwise by now: then their tracks go on elsewhere on them.
        """
        found = are_in(increasing(landmark), self.lost)
        if not found.any():
            return self
        again = are_in(np.sort(self.lost[found]), self.prior.number)
        number, points = self.prior.number[again], self.prior.points(states.T_world_cam[0])[again]
        now = Looks.seen(number, points, states.T_world_cam[-1], states.twist[-1])
        drift = np.zeros((len(self.prior), 3))
        drift[again] = track_drift(build.noise, self.looks.change_to(now))
        prior = self.prior.moved(drift, build.camera)
        return KnownLandmarks(prior, self.lost[~found], self.looks.updated(now))


def track_drift(noise: NoiseConfig, change: Array) -> Array:
    """(N, 3) standard deviations of what tracks move on landmarks whose looks change (N,), pixels.

    Both pictures of a contour move alike, so that its disparity drifts by a share.
    """
    assert noise.track_drift is not None  # the smoother chose it by its camera
    return noise.track_drift * np.sqrt(change)[:, None] * [1.0, 1.0, noise.disparity_drift]
