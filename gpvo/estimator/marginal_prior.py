"""What clusters that have left the window told: a Gaussian of its first state and landmarks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from factors.lie import se3_inverse, se3_log
from gpvo.estimator.gaussian import Quadratic
from gpvo.estimator.landmarks import Landmarks
from gpvo.trajectory.states import States

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class MarginalPrior:
    """A quadratic cost of how far the first state and some landmarks are from where they were.

    Attributes
    ----------
    T_world_cam, twist
        (4, 4) pose and (6,) body twist of the state that it was linearized at.
    landmarks
        The L landmarks as they were.
    quadratic
        Of 12 + 3 L variables: pose, perturbed on the right, twist, and coordinates.
    fixed
        Whether the cost must go on to be linearized there, as it comes from measurements that were.
    """

    T_world_cam: Array
    twist: Array
    landmarks: Landmarks
    quadratic: Quadratic
    fixed: bool = True

    @staticmethod
    def of_state(T_world_cam: Array, twist: Array, covariance: Array) -> MarginalPrior:
        """A state alone, with the covariance (12, 12) of its pose and twist."""
        information = np.linalg.inv(covariance)
        quadratic = Quadratic(0.5 * (information + information.T), np.zeros(12))
        return MarginalPrior(T_world_cam, twist, Landmarks(), quadratic, fixed=False)

    def deviation(self, states: States, landmarks: Landmarks) -> Array:
        """(12 + 3 L,) difference from where the prior was linearized."""
        here = landmarks.coordinates[landmarks.index(self.landmarks.number)]
        return np.concatenate(
            [
                se3_log(se3_inverse(self.T_world_cam) @ states.T_world_cam[0]),
                states.twist[0] - self.twist,
                (here - self.landmarks.coordinates).ravel(),
            ]
        )

    def imposed(self, states: States, landmarks: Landmarks) -> tuple[States, Landmarks]:
        """All variables, but those of a fixed prior where it was linearized."""
        if not self.fixed:
            return states, landmarks
        T, twist = states.T_world_cam.copy(), states.twist.copy()
        T[0], twist[0] = self.T_world_cam, self.twist
        coordinates = landmarks.coordinates.copy()
        coordinates[landmarks.index(self.landmarks.number)] = self.landmarks.coordinates
        return States(states.t, T, twist), replace(landmarks, coordinates=coordinates)

    def without(self, number: Index) -> MarginalPrior:
        """The same belief, but not about landmarks of these numbers."""
        stays = ~np.isin(self.landmarks.number, number)
        order = np.argsort(np.concatenate([np.ones(12), np.repeat(stays, 3)]), kind="stable")
        H, g = self.quadratic.H[np.ix_(order, order)], self.quadratic.g[order]
        marginal = Quadratic(H, g, self.quadratic.c).marginal(3 * int(np.sum(~stays)))
        return replace(self, landmarks=self.landmarks[stays], quadratic=marginal)
