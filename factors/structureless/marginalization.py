"""The first states of a window leave: a factor of their neighbours, and a prior of landmarks.

Given the states that leave, x_0 to x_(b-1), the variables between them and those of the last prior,
together y, the landmarks are independent. Given the state x_b at which the window now begins, y is
Gaussian, y = mu + S dx_b + P s, s ~ N(0, 1), by all factors that touch the states that leave.
Put into the landmarks' rows it gives their new prior, whose variables s are as many as y has. A
singular value decomposition leaves the few of them that matter; what the others add goes to each
landmark's own noise. So the estimate of the states that stay is the one of a graph with all the
landmarks in it, while the cost of an update does not grow with the time a landmark is seen.
"""

from __future__ import annotations

from typing import NamedTuple

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from factors.kernels.se3 import Array
from factors.linear_states import LinearStatesFactor
from factors.structureless.identities import are_in, increasing
from factors.structureless.joint_system import Eliminated, JointSystem, prior_columns, root_kernel
from factors.structureless.landmark_prior import (
    LandmarkPrior,
    drift_of_coordinates,
    points_of,
    views_of,
)
from factors.structureless.multi_landmark import StructurelessStereoFactor
from factors.structureless.prior_kernels import known_from_kernel

Index = NDArray[np.int64]

SHARED = 24
"""Variables that the errors of all landmarks of a prior share, at most."""

AHEAD = 0.2
"""Least depth of a landmark, as a share of its distance: x / z and y / z end beside the camera."""

VIEWS = np.array(
    [
        [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
        [(1, 0, 0), (0, 0, -1), (0, 1, 0)],
        [(1, 0, 0), (0, 0, 1), (0, -1, 0)],
        [(0, 0, 1), (0, 1, 0), (-1, 0, 0)],
        [(0, 0, -1), (0, 1, 0), (1, 0, 0)],
        [(-1, 0, 0), (0, 1, 0), (0, 0, -1)],
    ],
    np.float64,
)
"""R_cam_view (6, 3, 3) of the views of landmarks: the camera's, and the other faces of a cube."""


class Marginal(NamedTuple):
    """What is left of measurements whose states leave a window.

    `factor` is of the states that leave and of the first that stays; GTSAM marginalises it with
    them. `prior` is of the landmarks, given the first state that stays.
    """

    factor: LinearStatesFactor
    prior: LandmarkPrior


def marginalize(
    structureless: StructurelessStereoFactor,
    values: gtsam.Values,
    count: int,
    others: gtsam.NonlinearFactorGraph,
    landmarks: ArrayLike,
    drift: ArrayLike = (0.0, 0.0, 0.0),
    shared: int = SHARED,
) -> Marginal:
    """Marginalise the measurements before the state number `count` out of a structureless factor.

    Parameters
    ----------
    structureless
        Factor of all measurements in the window, with a Q_c or a prior.
    values
        Where to linearise: all states of the factor. If it was linearised before, its landmarks are
        taken where Gauss-Newton's step moved them.
    count
        Number of its first states that leave; at least one, and at least one stays.
    others
        The other factors between the states that leave and the first that stays.
    landmarks
        Identities of the landmarks to keep, those that may be measured later.
    drift
        (3,) standard deviation of how far the tracks of landmarks, (u_left, v, disparity), have
        moved on these since the last prior; pixels. Zero if landmarks are points. Or (L, 3), one
        for each of `structureless.landmark_numbers`.
    shared
        Largest number of variables s of the new prior.

    Raises
    ------
    ValueError
        If `count` leaves no state, or the system is singular.
    """
    window = structureless.window
    if window.between.by_body is not None:
        raise ValueError("structureless must be of the camera's own states, without T_body_cam")
    if not 0 < count < len(window.between.states):
        raise ValueError(f"count must be 1 to {len(window.between.states) - 1}, not {count}")
    T_states, v_states = window.between.read(values)
    fit = window.moved_fit(T_states, v_states, count + 1)
    rows = window.rows(T_states, v_states, fit, count + 1)
    system = JointSystem.of_rows(rows, len(fit.coordinates))
    keys = window.between.keys[: 2 * (count + 1)]
    factor = LinearStatesFactor(
        keys, T_states[: count + 1], v_states[: count + 1], root_kernel(*system.on_states())
    )
    try:
        given = _leaving_given_next(system, information_of(others, values, keys))
    except np.linalg.LinAlgError as error:
        raise ValueError("the states that leave are not determined") from error
    number = structureless.landmark_numbers
    moved = drift_of_coordinates(drift, len(number), window.landmarks.camera)
    rests, keep = are_in(structureless.resting.number, number), increasing(np.asarray(landmarks))
    seen = _Known(number[~rests], fit.charts, fit.coordinates, moved[~rests], system.landmarks)
    s = window.prior_shared(T_states, v_states)
    first = T_states[0], v_states[0]
    away = _resting(structureless.resting, *first, s, int(system.latent[-1]), moved[rests])
    parts = [part.only(are_in(keep, part.number) & part.is_known) for part in (seen, away)]
    return Marginal(factor, _prior(parts, given, (T_states[count], v_states[count]), shared))


class _Known(NamedTuple):
    """Landmarks of numbers (n,) at coordinates (n, 3) in charts (n, 4, 4), and their rows.

    Coordinates have moved by standard deviations (n, 3).
    """

    number: Index
    charts: Array
    coordinates: Array
    moved: Array
    by: Eliminated

    @property
    def is_known(self) -> NDArray[np.bool_]:
        """(n,) which are determined, and ahead of their view: a far step may take them behind."""
        return (self.by.known > 0) & (self.coordinates[:, 2] > 0)

    def only(self, keep: NDArray[np.bool_]) -> _Known:
        """Return those that are kept (n,)."""
        number, charts, coordinates, moved, (columns, *rows) = self
        by = Eliminated(columns, *(row[keep] for row in rows))
        return _Known(number[keep], charts[keep], coordinates[keep], moved[keep], by)


def _resting(
    prior: LandmarkPrior, T_first: Array, v_first: Array, s: Array, column: int, moved: Array
) -> _Known:
    """The landmarks of a prior that are not measured; its variables s have columns from one on.

    They have as many rows as coordinates, which need no elimination.
    """
    rows = prior.at(T_first, v_first)
    charts, coordinates = prior.views(T_first), prior.without_error(rows, s)
    by_landmark = prior.with_landmarks(T_first, rows, charts, coordinates)
    columns = prior_columns(column, rows.shape[2])
    by = Eliminated(columns, by_landmark, rows, np.ones(len(prior)))
    return _Known(prior.number, charts, coordinates, moved, by)


def _turns_to(points: Array, T_world_cam: Array) -> Array:
    """Return the turns R_cam_view (P, 3, 3) of views that have points (P, 3) ahead.

    It is the camera's own view if that has: see AHEAD.
    """
    local = (points - T_world_cam[:3, 3]) @ T_world_cam[:3, :3]
    ahead = local[:, 2] > AHEAD * np.linalg.norm(local, axis=1)
    return VIEWS[np.where(ahead, 0, np.argmax(local @ VIEWS[:, :, 2].T, axis=1))]


def information_of(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, keys: list[int]
) -> Array:
    """(D + 1, D + 1) [J e]ᵀ[J e] of a graph, with columns in the order of the keys."""
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(key)
    information = np.zeros((6 * len(keys) + 1, 6 * len(keys) + 1))
    if graph.size():
        information += graph.linearize(values).augmentedHessian(ordering)
    # GTSAM's right-hand side is -e.
    information[-1, :-1] *= -1
    information[:-1, -1] *= -1
    return information


class _Leaving(NamedTuple):
    """y = (S, mean) (dx_b, 1) + spread s: (Y, 13), and a triangular (Y, Y).

    The columns of y are the first ones, those of the state b and of the error the last 13.
    """

    by_next: Array
    spread: Array


def _leaving_given_next(system: JointSystem, others: Array) -> _Leaving:
    """The distribution of what leaves, given the next state."""
    H = system.information.copy()
    H[system.shared :, system.shared :] += others
    scale = np.diag(H)[:-13]
    if not (scale > 0).all():
        raise np.linalg.LinAlgError("no factor tells of a state that leaves")
    unit = 1 / np.sqrt(scale)
    root = np.linalg.cholesky(unit[:, None] * H[:-13, :-13] * unit)
    spread = unit[:, None] * np.linalg.inv(root).T
    return _Leaving(-spread @ (spread.T @ H[:-13, -13:]), spread)


def _prior(
    parts: list[_Known], given: _Leaving, state: tuple[Array, Array], shared: int
) -> LandmarkPrior:
    """Make the prior of landmarks (P,), given the state of its window."""
    turn = _turned([part.by for part in parts], given, shared)
    number = increasing(*(part.number for part in parts))
    d, count = min(shared, len(turn) - 13), len(number)
    turns = np.empty((count, 3, 3))
    found = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3, d + 13))
    for part in parts:
        place = np.searchsorted(number, part.number)
        turned = (part.by.flat @ turn[part.by.columns]).reshape(-1, 3, len(turn))
        ahead = _turns_to(points_of(part.coordinates, part.charts), state[0])
        views, turns[place] = views_of(state[0], ahead), ahead
        known = part.charts, part.coordinates, part.moved, part.by.root
        known_from_kernel(views, ahead, place, *known, turned, *found)
    seen, root, rows = found
    return LandmarkPrior(number, seen, turns, root, rows, *state)


def _turned(some: list[Eliminated], given: _Leaving, shared: int) -> Array:
    """(Y + 13, Y + 13) that makes the variables that matter most, the next state and the error.

    All others come after them.
    """
    count = len(given.spread)
    square = np.zeros((count + 13, count + 13))
    for part in some:
        square[part.columns[:, None], part.columns] += part.flat.T @ part.flat
    _, vectors = np.linalg.eigh(given.spread.T @ square[:count, :count] @ given.spread)
    turn, d = given.spread @ vectors[:, ::-1], min(shared, count)
    found = np.zeros_like(square)
    found[:count] = np.concatenate([turn[:, :d], given.by_next, turn[:, d:]], axis=1)
    found[count:, d : d + 13] = np.eye(13)
    return found
