"""LIBVISO2's outlier rejection: a match must agree with its neighbours in the image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError


def are_supported(
    points: NDArray[np.int32],
    flow: NDArray[np.int32],
    disparity: NDArray[np.int32],
    flow_tolerance: float,
    disparity_tolerance: float,
    least: int,
) -> NDArray[np.bool_]:
    """Check whether enough neighbours in the triangulation of points (N, 2) agree with each match.

    Flow (N, 2) is compared in the L1 norm, disparity (N,) by its difference. At least `least` edges
    of triangles must agree, where an edge between two triangles counts twice. Fewer than four
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
        support += np.bincount(np.append(p[agree], q[agree]), minlength=len(points))
    return support >= least
