"""The error of a factor at a time between two states, and its noise."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import Any

import gtsam
import numpy as np

from factors.checks import checked_finite_noise
from factors.inner_factor import Inner
from factors.jacobian_blocks import Jacobians, blocks_of
from factors.kernels.between import chain_kernel, state_at_kernel, whiten_between_kernel
from factors.kernels.points import point_between_kernel
from factors.kernels.se3 import Array
from factors.points import PointError

Ends = tuple[Array, Array, Array, Array]
"""Pose (4, 4) and twist (6,) of both states."""


class NoiseBetween:
    """Noise of a measurement between two states, to which these leave the state at t uncertain.

    Attributes
    ----------
    model
        Of the whitened error.
    parts
        The covariance (m, m) of the measurement, and the `whitening` (6, 6) of the power spectral
        density.
    """

    def __init__(self, model: gtsam.noiseModel.Base, W: Array) -> None:
        checked_finite_noise(model, model.dim())
        gaussian: Any = model
        self.model: gtsam.noiseModel.Base = gtsam.noiseModel.Unit.Create(model.dim())
        if isinstance(model, gtsam.noiseModel.Robust):
            gaussian = model.noise()
            self.model = gtsam.noiseModel.Robust.Create(model.robust(), self.model)
        self.parts = np.ascontiguousarray(gaussian.covariance()), W


class PointInterpolation:
    """Error function of a measured point at a time between two states: all in one kernel."""

    def __init__(
        self, point: PointError, keys: list[int], t: Array, noise: NoiseBetween | None
    ) -> None:
        self._keys, m = keys, len(point.lines)
        root = (np.empty((0, 0)), np.empty((0, 0))) if noise is None else noise.parts
        self._constants = t, point.point, point.lines, *root
        self._blocks = blocks_of(m, (6, 6, 6, 6))

    def __call__(self, values: gtsam.Values, jacobians: Jacobians) -> Array:
        pose_i, velocity_i, pose_j, velocity_j = self._keys
        own = self._blocks.own
        point_between_kernel(
            values.atPose3(pose_i).matrix(),
            values.atVector6(velocity_i),
            values.atPose3(pose_j).matrix(),
            values.atVector6(velocity_j),
            *self._constants,
            own.outputs,
        )
        if jacobians is not None:
            own.copy_to(jacobians)
        return own.error


class Interpolation:
    """Error function of an inner one at a time between two states."""

    def __init__(
        self,
        inner: Inner,
        keys: list[int],
        at_t: tuple[int | None, int | None],
        t: Array,
        noise: NoiseBetween | None,
    ) -> None:
        self._inner, self._keys, self._t, self._noise = inner, keys, t, noise
        self._pose, self._velocity = at_t
        self._others = [key for key in inner.keys if key not in at_t]
        self._unset = gtsam.JacobianVector([np.empty((0, 0))] * len(inner.keys))
        self._shapes: list[tuple[int, ...]] | None = None
        self._identity = gtsam.Values()
        if self._pose is not None:
            self._identity.insert(self._pose, gtsam.Pose3())
        if self._velocity is not None:
            self._identity.insert(self._velocity, np.zeros(6))

    def __call__(self, values: gtsam.Values, jacobians: Jacobians) -> Array:
        pose_i, velocity_i, pose_j, velocity_j = self._keys[:4]
        ends = (
            values.atPose3(pose_i).matrix(),
            values.atVector6(velocity_i),
            values.atPose3(pose_j).matrix(),
            values.atVector6(velocity_j),
        )
        found = np.empty(54)
        state_at_kernel(*ends, self._t, found)
        at_t = self._values_at(values, found)
        if jacobians is None and self._noise is None:
            return self._inner.evaluate(at_t, None)
        by_inner = gtsam.JacobianVector(self._unset)
        error = self._inner.evaluate(at_t, by_inner)
        rows = [by_inner[k].T for k in range(len(by_inner))]
        shapes = [each.shape for each in rows]
        if shapes != self._shapes:
            self._prepare(shapes, at_t)
        if self._noise is not None:
            *rows, error = self._whitened(ends, found, [*rows, error])
        by_pose, by_twist = (self._none if k is None else rows[k] for k in self._places)
        blocks = self._blocks.own
        chain_kernel(ends[3], self._t, found, by_pose, by_twist, blocks.outputs)
        for k, place in self._shared:  # a state may also be one of the inner factor's own
            if place < 4:
                blocks.views[place][...] += rows[k].T
            else:
                blocks.views[place][...] = rows[k].T
        if jacobians is not None:
            blocks.copy_to(jacobians)
        return error

    def _values_at(self, values: gtsam.Values, found: Array) -> gtsam.Values:
        """Return the values of the inner factor, the state at t among them.

        It is retracted from the identity, because GTSAM looks for the `insert` of a Pose3 among 46
        of them, for longer than all else takes.
        """
        step = gtsam.VectorValues()
        if self._pose is not None:
            step.insert(self._pose, found[48:])
        if self._velocity is not None:
            step.insert(self._velocity, found[:6])
        at_t = self._identity.retract(step)
        if self._others:
            at_t.insert(values.extract(self._others))
        return at_t

    def _prepare(self, shapes: list[tuple[int, ...]], at_t: gtsam.Values) -> None:
        """Check the shapes of the transposed Jacobians, and find out where they belong."""
        inner, zeros = self._inner, at_t.zeroVectors()
        m, sizes = inner.model.dim(), [len(zeros.at(key)) for key in inner.keys]
        if shapes != [(size, m) for size in sizes]:
            wanted, given = [(m, size) for size in sizes], [shape[::-1] for shape in shapes]
            raise ValueError(f"an error function must set jacobians of {wanted}, not {given}")
        self._none, of_state = np.empty((0, m)), (self._pose, self._velocity)
        self._places = [None if key is None else inner.keys.index(key) for key in of_state]
        self._columns = list(pairwise(accumulate(sizes, initial=0)))
        self._first = np.array([-1 if k is None else self._columns[k][0] for k in self._places])
        self._shared = [(inner.keys.index(key), self._keys.index(key)) for key in self._others]
        own = {place: sizes[k] for k, place in self._shared}
        self._blocks = blocks_of(m, tuple(own.get(k, 6) for k in range(len(self._keys))))
        self._shapes = shapes

    def _whitened(self, ends: Ends, found: Array, rows: list[Array]) -> list[Array]:
        """Whiten the transposed Jacobians and the error."""
        system = np.vstack(rows)
        assert self._noise is not None
        parts = self._noise.parts
        whiten_between_kernel(*ends, self._t, *parts, self._first, found, system.T)
        return [*(system[first:end] for first, end in self._columns), system[-1]]
