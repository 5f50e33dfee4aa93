"""Circular matching of stereo features by their descriptors, in the manner of LIBVISO2.

Section III-A.2 of the paper: current left, current right, previous right, previous left and back to
current left; what returns to its start is a quad match.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from gpvo.config import Viso2Config
from gpvo.features import Features

NO_MATCH = -1
MIN_SUPPORT = 4  # agreeing triangle edges that a match needs; an interior edge counts twice


@dataclass(frozen=True, eq=False)
class IndexedFeatures:
    """Features of one image sorted by kind and row, for search."""

    features: Features
    height: int

    @cached_property
    def _order_and_start(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices by kind and row, and where each (kind, row) starts among them."""
        key = self.features.kind.astype(np.int64) * self.height + self.features.points[:, 1]
        order = np.argsort(key, kind="stable")
        return order, np.searchsorted(key[order], np.arange(4 * self.height + 1))

    def search(
        self,
        queries: Features,
        selected: NDArray[np.int64],
        columns: tuple[float, float],
        rows: tuple[float, float],
    ) -> NDArray[np.int64]:
        """Best match of the same kind for every selected query, or NO_MATCH.

        Candidates lie within `columns` and `rows` (lowest, highest) of the query's point; the
        smallest sum of absolute descriptor differences wins, the first one if several are equal.
        """
        order, start = self._order_and_start
        return _search(
            queries.points,
            queries.kind,
            queries.descriptors,
            selected,
            self.features.points,
            self.features.descriptors,
            order,
            start,
            self.height,
            np.array([*columns, *rows]),
        )


@njit(cache=True)
def _search(
    query_points: NDArray[np.int32],
    query_kind: NDArray[np.int32],
    query_descriptors: NDArray[np.uint8],
    selected: NDArray[np.int64],
    points: NDArray[np.int32],
    descriptors: NDArray[np.uint8],
    order: NDArray[np.int64],
    start: NDArray[np.int64],
    height: int,
    window: NDArray[np.float64],
) -> NDArray[np.int64]:
    best = np.full(len(selected), NO_MATCH, np.int64)
    for s in range(len(selected)):
        i = selected[s]
        if i == NO_MATCH:
            continue
        first_row = max(0, query_points[i, 1] + int(window[2]))
        last_row = min(height - 1, query_points[i, 1] + int(window[3]))
        base = query_kind[i] * height
        lowest = np.int64(1) << 40
        for m in range(start[base + first_row], start[base + last_row + 1]):
            j = order[m]
            offset = points[j, 0] - query_points[i, 0]
            if window[0] <= offset <= window[1]:
                difference = _absolute_difference(query_descriptors[i], descriptors[j])
                if difference < lowest or (difference == lowest and j < best[s]):
                    lowest, best[s] = difference, j
    return best


@njit(cache=True)
def _absolute_difference(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> np.int64:
    total = np.int64(0)
    for i in range(len(a)):
        total += abs(np.int64(a[i]) - np.int64(b[i]))
    return total


@dataclass(frozen=True, eq=False)
class StereoFeatures:
    """Features of a rectified stereo pair."""

    left: IndexedFeatures
    right: IndexedFeatures


def match_quads(
    current: StereoFeatures,
    previous: StereoFeatures,
    frames_between: int,
    config: Viso2Config,
) -> NDArray[np.int64]:
    """Quad matches (M, 4): feature indices in current left, current right, previous right, left.

    Each survives the circle with positive disparities and is supported by its Delaunay neighbours.
    """
    flow = (-config.flow_radius * frames_between, config.flow_radius * frames_between)
    to_right = (-config.max_disparity, -1)
    to_left = (1, config.max_disparity)
    rows = (-config.row_tolerance, config.row_tolerance)

    start = np.arange(len(current.left.features))
    right = current.right.search(current.left.features, start, to_right, rows)
    previous_right = previous.right.search(current.right.features, right, flow, flow)
    previous_left = previous.left.search(previous.right.features, previous_right, to_left, rows)
    end = current.left.search(previous.left.features, previous_left, flow, flow)

    quads = np.stack([start, right, previous_right, previous_left], axis=1)[end == start]
    return quads[_are_supported(quads, current, previous, config)]


def _are_supported(
    quads: NDArray[np.int64],
    current: StereoFeatures,
    previous: StereoFeatures,
    config: Viso2Config,
) -> NDArray[np.bool_]:
    images = (current.left, current.right, previous.right, previous.left)
    left, _, previous_right, previous_left = (
        image.features.points[index] for image, index in zip(images, quads.T, strict=True)
    )
    return delaunay_support(
        left,
        left - previous_left,
        previous_left[:, 0] - previous_right[:, 0],
        config.outlier_flow_tolerance,
        config.outlier_disparity_tolerance,
    )


def delaunay_support(
    points: NDArray[np.int32],
    flow: NDArray[np.int32],
    disparity: NDArray[np.int32],
    flow_tolerance: float,
    disparity_tolerance: float,
) -> NDArray[np.bool_]:
    """Whether enough neighbours in the triangulation of points (N, 2) move as each match does.

    Flow (N, 2) is compared in the L1 norm, disparity (N,) by its difference. Fewer than four
    matches, or matches on a line, cannot be judged and are kept.
    """
    if len(points) < 4:
        return np.ones(len(points), bool)
    try:
        triangles = Delaunay(points).simplices
    except QhullError:
        return np.ones(len(points), bool)
    support = np.zeros(len(points), np.int64)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        p, q = triangles[:, first], triangles[:, second]
        agree = np.abs(flow[p] - flow[q]).sum(axis=1) < flow_tolerance
        agree &= np.abs(disparity[p] - disparity[q]) < disparity_tolerance
        np.add.at(support, p[agree], 1)
        np.add.at(support, q[agree], 1)
    return support >= MIN_SUPPORT
