"""The error of a motion prior in any space, and what lies between its states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from factors.factor import Evaluate
from factors.interpolation import given_states
from factors.jacobian_blocks import Jacobians, blocks_of
from factors.kernels.jerk import (
    local_motion_kernel,
    quintic_weights,
    retract_motion_kernel,
    wnoj_kernel,
)
from factors.kernels.local_variables import hermite_weights, wnoa_kernel
from factors.kernels.se3 import Array
from factors.kernels.whitened import whitened_wnoa_kernel, whitened_wnoj_kernel
from factors.spaces import Space
from factors.variables import vector
from factors.wnoa import information_root, kronecker

Places = NDArray[np.int64]

_OF_POINTS: dict[int, Any] = {
    1: gtsam.WnoaMotionFactorPoint1,
    2: gtsam.WnoaMotionFactorPoint2,
    3: gtsam.WnoaMotionFactorPoint3,
}


class PriorError:
    """Error function of a prior, and what lies between its states.

    Attributes
    ----------
    evaluate, model
        The error and its Jacobians, and its noise model: Unit of poses, whose error is whitened.
    size
        Number of errors, and of columns of one state.
    kinds
        Of the pose and of its rates.
    """

    def __init__(
        self,
        space: Space | None,
        order: int,
        keys: Sequence[int],
        dt: float,
        W: Array,
        higher: float,
        acceleration: Array | None = None,
    ) -> None:
        self._space, self._order, self._keys, self._dt, self._W = space, order, keys, dt, W
        self.size = order * len(W)
        rate = vector(len(W))
        self.kinds = (rate if space is None else space.kind, rate)
        self.model: gtsam.noiseModel.Base = gtsam.noiseModel.Unit.Create(self.size)
        if space is None:
            self.evaluate = self._of_vectors()
            S = np.linalg.qr(kronecker(information_root(dt, order), W), mode="r")
            self.model = gtsam.noiseModel.Gaussian.SqrtInformation(S, False)
        elif order == 3:
            self.evaluate = self._of_poses_by_jerk(space.places)
        else:
            mean = np.zeros(len(W)) if acceleration is None else acceleration
            self.evaluate = self._of_poses(space.places, higher, mean)

    def _of_poses(self, places: Places, higher: float, acceleration: Array) -> Evaluate:
        """Error function of WNOA, whose Jacobians beyond first order have the weight `higher`.

        `places` are those of the space, `acceleration` (n,) is the mean acceleration.
        """
        W, root = self._W, information_root(self._dt, 2)
        diagonal = float(np.count_nonzero(W) == len(W))
        scalars = self._dt, root[0, 0], root[0, 1], root[1, 1], higher, diagonal
        constants = np.concatenate([scalars, W.ravel(), acceleration])
        blocks = blocks_of(self.size, (len(W),) * 4)
        pose, rate = (kind.read for kind in self.kinds)
        pose_i, v_i, pose_j, v_j = self._keys

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            own = blocks.own
            whitened_wnoa_kernel(
                pose(values, pose_i).matrix(),
                rate(values, v_i),
                pose(values, pose_j).matrix(),
                rate(values, v_j),
                places,
                constants,
                jacobians is not None,
                own.outputs,
            )
            if jacobians is not None:
                own.copy_to(jacobians)
            return own.error

        return error

    def _of_poses_by_jerk(self, places: Places) -> Evaluate:
        """Error function of WNOJ."""
        root = information_root(self._dt, 3)
        constants = np.concatenate([[self._dt], root.ravel(), self._W.ravel()])
        blocks = blocks_of(self.size, (len(self._W),) * 6)
        pose, rate = (kind.read for kind in self.kinds)
        pose_i, v_i, a_i, pose_j, v_j, a_j = self._keys

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            own = blocks.own
            whitened_wnoj_kernel(
                pose(values, pose_i).matrix(),
                rate(values, v_i),
                rate(values, a_i),
                pose(values, pose_j).matrix(),
                rate(values, v_j),
                rate(values, a_j),
                places,
                constants,
                own.outputs,
            )
            if jacobians is not None:
                own.copy_to(jacobians)
            return own.error

        return error

    def _of_vectors(self) -> Evaluate:
        """Error function of vectors, which is linear in them.

        GTSAM's own reads all and writes its Jacobians in half the time that Python takes to read.
        """
        n, keys, read = len(self._W), self._keys, self.kinds[1].read
        if self._order == 2 and n in _OF_POINTS:
            x_i, v_i, x_j, v_j = keys
            states = gtsam.StateData(x_i, v_i, 0.0), gtsam.StateData(x_j, v_j, self._dt)
            return _OF_POINTS[n](*states, np.ones(n)).unwhitenedError
        J = self._linearized([], [], self._dt)
        blocks = [np.asfortranarray(J[:, k : k + n]) for k in range(0, J.shape[1], n)]
        constant = gtsam.JacobianVector(blocks)

        def error(values: gtsam.Values, jacobians: Jacobians) -> Array:
            if jacobians is not None:
                jacobians.clear()
                jacobians.extend(constant)
            return J @ np.concatenate([read(values, key) for key in keys])

        return error

    def _read(self, values: gtsam.Values) -> tuple[list[Array], list[Array]]:
        """Return both states: a transform, or a vector, and its rates, in the columns of SE(3)."""
        kinds, space = [self.kinds[0], *[self.kinds[1]] * (self._order - 1)] * 2, self._space
        found = [kind.read(values, key) for kind, key in zip(kinds, self._keys, strict=True)]
        if space is not None:
            found = [
                space.to_transform(each) if n % self._order == 0 else space.to_twist(each)
                for n, each in enumerate(found)
            ]
        return found[: self._order], found[self._order :]

    def _linearized(self, i: list[Array], j: list[Array], dt: float) -> Array:
        """Return the Jacobian (order n, 2 order n), not whitened."""
        if self._space is None:
            transition = _transition(self._order, len(self._W), dt)
            return np.hstack([-transition, np.eye(self.size)])
        whole = wnoa_kernel(*i, *j, dt) if self._order == 2 else wnoj_kernel(*i, *j, dt)
        rows = np.add.outer(6 * np.arange(2 * self._order), self._space.columns).ravel()
        return np.asarray(whole[np.ix_(rows[: self.size], rows)])

    def interpolate(self, values: gtsam.Values, t: float) -> tuple[Any, ...]:
        """Return pose and rates t seconds after state i."""
        i, j = self._read(values)
        rest = t, self._dt - t
        weights = (hermite_weights if self._order == 2 else quintic_weights)(*rest)
        if self._space is None:
            return tuple(np.einsum("eab,ebn->an", weights, np.array([i, j])))
        at_j = local_motion_kernel(i[0], j[0], j[1], j[-1])[:, 24].reshape(3, 6)[: self._order]
        at_i = np.stack([np.zeros(6), *i[1:]])
        local = np.zeros(18)
        local[: 6 * self._order] = (weights[0] @ at_i + weights[1] @ at_j).ravel()
        T, v, a = np.empty((4, 4)), np.empty(6), np.empty(6)
        retract_motion_kernel(i[0], local, T, v, a)
        rates = [rate[list(self._space.columns)] for rate in (v, a)[: self._order - 1]]
        return (self._space.from_transform(T), *rates)

    def covariance(
        self, values: gtsam.Values, between: tuple[Any, ...], t: float, joint: Array
    ) -> Array:
        """Return the covariance of a state between, as one more state of the graph."""
        size, space = self.size, self._space
        if t == 0 or t == self._dt:
            own = slice(0, size) if t == 0 else slice(size, None)
            return joint[own, own].copy()
        i, j = self._read(values)
        middle = list(between)
        if space is not None:
            middle = [space.to_transform(between[0]), *map(space.to_twist, between[1:])]
        before, after = (
            kronecker(information_root(dt, self._order), self._W) @ self._linearized(one, other, dt)
            for one, other, dt in ((i, middle, t), (middle, j, self._dt - t))
        )
        (gain,), (own_root,) = given_states(before[None], after[None])
        return np.asarray(gain @ joint @ gain.T + own_root @ own_root.T)


def _transition(order: int, size: int, dt: float) -> Array:
    """(order n, order n) transition of a vector and its rates over dt."""
    powers = [[1, dt, dt * dt / 2], [0, 1, dt], [0, 0, 1]]
    return np.kron(np.array(powers)[:order, :order], np.eye(size))
