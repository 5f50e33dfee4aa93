"""Landmarks that are found again are as certain as they look alike."""

from __future__ import annotations

import numpy as np
from synthetic import CAMERA

from factors import LandmarkPrior
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator.graph_builder import GraphBuilder
from gpvo.estimator.known_landmarks import KnownLandmarks, track_drift
from gpvo.estimator.landmark_looks import Looks
from gpvo.trajectory import States

RIGHT = np.array([0, 0, 0, 1.0, 0, 0])
NUMBER, SEEN = np.array([2, 5, 8]), np.array([[0.1, 0, 0.25], [0, 0.1, 0.5], [-0.1, 0, 0.2]])
BUILD = GraphBuilder(CAMERA, NoiseConfig(track_drift=0.5), EstimatorConfig())


def known() -> KnownLandmarks:
    """Landmarks that passed from right to left, the first two of which were lost."""
    views, root = np.tile(np.eye(3), (3, 1, 1)), np.tile(1e3 * np.eye(3), (3, 1, 1))
    prior = LandmarkPrior(NUMBER, SEEN, views, root, np.zeros((3, 3, 13)), np.eye(4), RIGHT)
    looks = Looks.seen(NUMBER, prior.points(np.eye(4)), np.eye(4), RIGHT)
    return KnownLandmarks(prior, np.array([5, 2]), looks)


def seen_again(landmark: list[int], twist: np.ndarray) -> KnownLandmarks:
    states = States(np.array([0.0, 0.1]), np.tile(np.eye(4), (2, 1, 1)), np.tile(twist, (2, 1)))
    return known().seen_again(np.array(landmark), states, BUILD)


def variances(found: KnownLandmarks) -> np.ndarray:
    root = found.prior.root
    return np.diagonal(np.linalg.inv(root.transpose(0, 2, 1) @ root), axis1=1, axis2=2)


def test_those_that_look_otherwise_are_less_certain() -> None:
    found = seen_again([5, 8], -RIGHT)
    pixels = track_drift(BUILD.noise, np.array([2.0]))[0]
    drift = pixels / [CAMERA.fx, CAMERA.fy, CAMERA.fx * CAMERA.baseline]
    added = variances(found) - variances(known())
    np.testing.assert_allclose(added, [np.zeros(3), drift**2, np.zeros(3)], atol=1e-15)
    assert found.lost.tolist() == [2]
    points = found.prior.points(np.eye(4))
    now = Looks.seen(NUMBER, points, np.eye(4), -RIGHT)
    np.testing.assert_allclose(found.looks.change_to(now), [2.0, 0.0, 2.0], atol=1e-9)


def test_those_that_look_alike_are_as_certain() -> None:
    found = seen_again([2, 5], 3.0 * RIGHT)
    np.testing.assert_allclose(variances(found), variances(known()), rtol=1e-9)
    assert found.lost.tolist() == []


def test_nothing_changes_if_none_was_lost() -> None:
    before = known()
    states = States(np.zeros(1), np.eye(4)[None], -RIGHT[None])
    assert before.seen_again(np.array([8, 9]), states, BUILD) is before
