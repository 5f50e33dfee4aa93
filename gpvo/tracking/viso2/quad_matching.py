"""Circular matching of stereo features by their descriptors, in the manner of LIBVISO2.

Section III-A.2 of the paper: features are matched from current left to current right, previous
right, previous left and back to current left. A feature that returns to itself is a quad match.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from factors.kernels.compiled import kernel
from gpvo.config import Viso2Config
from gpvo.tracking.features import Features
from gpvo.tracking.viso2.delaunay_support import are_supported
from gpvo.tracking.viso2.search_ranges import SearchRanges

NO_MATCH = -1


@dataclass(frozen=True, eq=False)
class IndexedFeatures:
    """Features of one image for search, made by `index_features`.

    Attributes
    ----------
    features
        In order of kind, row and column.
    start
        (4 height + 1,) index of the first feature of each kind and row, then their number.
    """

    features: Features
    start: NDArray[np.int64]

    def search(
        self,
        queries: Features,
        selected: NDArray[np.int64],
        windows: NDArray[np.float64],
    ) -> NDArray[np.int64]:
        """Find the best match (N,) of the same kind for the selected queries (N,), or NO_MATCH.

        The displacement of a candidate from the query's point must lie within the query's window:
        `windows` (N, 4) holds the lowest and highest displacement along u, then along v. The
        smallest sum of absolute descriptor differences wins, and the first one if several are
        equal.
        """
        return _search(
            queries.points,
            queries.kind,
            queries.descriptors,
            selected,
            self.features.points,
            self.features.descriptors,
            self.start,
            windows,
        )


def index_features(features: Features, height: int) -> IndexedFeatures:
    """Sort the features of an image with `height` rows."""
    column, row = features.points.T
    ordered = features[np.lexsort((column, row, features.kind))]
    key = ordered.kind.astype(np.int64) * height + ordered.points[:, 1]
    return IndexedFeatures(ordered, np.searchsorted(key, np.arange(4 * height + 1)))


@kernel
def _search(
    query_points: NDArray[np.int32],
    query_kind: NDArray[np.int32],
    query_descriptors: NDArray[np.uint8],
    selected: NDArray[np.int64],
    points: NDArray[np.int32],
    descriptors: NDArray[np.uint8],
    start: NDArray[np.int64],
    windows: NDArray[np.float64],
) -> NDArray[np.int64]:
    best = np.full(len(selected), NO_MATCH, np.int64)
    height = len(start) // 4
    for s in range(len(selected)):
        i = selected[s]
        if i == NO_MATCH:
            continue
        u, v = query_points[i]
        leftmost, rightmost, top, bottom = windows[s]
        first_row = max(0, v + int(np.ceil(top)))
        last_row = min(height - 1, v + int(np.floor(bottom)))
        if first_row > last_row:
            continue
        base = query_kind[i] * height
        lowest = np.int64(1) << 40
        for j in range(start[base + first_row], start[base + last_row + 1]):
            if leftmost <= points[j, 0] - u <= rightmost:
                difference = _absolute_difference(query_descriptors[i], descriptors[j])
                if difference < lowest:
                    lowest, best[s] = difference, j
    return best


@kernel
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
    ranges: SearchRanges,
    config: Viso2Config,
) -> NDArray[np.int64]:
    """Match features around the quad and return their indices (M, 4).

    The columns are current left, current right, previous right and previous left. Each match
    survives the circle within the ranges and is supported by its Delaunay neighbours.
    """
    windows = ranges.at(current.left.features.points)
    start = np.arange(len(current.left.features))
    right = current.right.search(current.left.features, start, windows[0])
    previous_right = previous.right.search(current.right.features, right, windows[1])
    previous_left = previous.left.search(previous.right.features, previous_right, windows[2])
    end = current.left.search(previous.left.features, previous_left, windows[3])
    quads = np.stack([start, right, previous_right, previous_left], axis=1)[end == start]

    left, _, previous_right, previous_left = quad_points(quads, current, previous)
    return quads[
        are_supported(
            left,
            left - previous_left,
            previous_left[:, 0] - previous_right[:, 0],
            config.outlier_flow_tolerance,
            config.outlier_disparity_tolerance,
            config.min_support,
        )
    ]


def stereo_matches(pair: StereoFeatures, ranges: SearchRanges) -> NDArray[np.int64]:
    """Return the left features (M,) whose best match in the right image matches best with them."""
    windows = ranges.at(pair.left.features.points)
    start = np.arange(len(pair.left.features))
    right = pair.right.search(pair.left.features, start, windows[0])
    return start[pair.left.search(pair.right.features, right, windows[2]) == start]


def quad_points(
    quads: NDArray[np.int64], current: StereoFeatures, previous: StereoFeatures
) -> NDArray[np.int32]:
    """Return the points (4, M, 2) of quads (M, 4)."""
    images = (current.left, current.right, previous.right, previous.left)
    return np.stack(
        [image.features.points[index] for image, index in zip(images, quads.T, strict=True)]
    )
