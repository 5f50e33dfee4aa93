"""Bad input is refused with the name of the argument, before it can spoil a graph."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import CAMERA, NOISE, QC
from gtsam.symbol_shorthand import L, V, X

from factors import (
    EuclideanVelocityFactor,
    InterpolatedStereoFactor,
    LandmarkPrior,
    ReprojectionVelocityFactor,
    StereoCamera,
    StereoReprojectionFactor,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    extrapolate,
    interpolate,
    prior_covariance,
    prior_square_root_information,
    wnoa_covariance,
)
from factors.lie import se3_inverse, se3_log
from factors.linear_states import LinearStatesFactor
from factors.wnoa import wnoa_error

good = np.array([180.0, 120.0, 6.0])
behind = np.array([180.0, 120.0, -6.0])
sheared = np.eye(4) + np.eye(4, k=1) * 1e-4
STATES = [gtsam.StateData(X(k), V(k), 0.1 * k) for k in range(2)]
two = gtsam.noiseModel.Unit.Create(2)


def prior(dt: float = 0.1, qc: Any = QC) -> object:
    return WnoaPriorFactor(X(0), V(0), X(1), V(1), dt, qc)


def stereo(
    measured: Any = good, model: Any = NOISE, camera: Any = CAMERA, T_body_cam: Any = None
) -> object:
    return StereoReprojectionFactor(measured, model, X(0), L(0), camera, T_body_cam)


def tracklet(model: Any = NOISE, states: Any = STATES) -> object:
    return StructurelessStereoFactor([good, good], [0.01, 0.02], 0, model, states, CAMERA)


def robust(model: Any) -> Any:
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(1.3), model)


def between(t: float = 0.05, measured: Any = good, model: Any = NOISE, qc: Any = None) -> object:
    keys = X(0), V(0), X(1), V(1), L(0)
    return InterpolatedStereoFactor(measured, model, *keys, CAMERA, 0.0, 0.1, t, qc)


def fast(point: Any = (0, 0, 3), dt: float = 0.1, measured: Any = (0, 0, 3)) -> object:
    return EuclideanVelocityFactor(measured, NOISE, V(0), point, dt)


def iterative(point: Any = (0, 0, 3), dt: float = 0.1, measured: Any = good) -> object:
    return ReprojectionVelocityFactor(measured, NOISE, V(0), point, dt, CAMERA)


def query(t: Any = 0.05, t_j: Any = 0.1, v_i: Any = (0,) * 6, **covariance: Any) -> object:
    return interpolate(np.eye(4), v_i, np.eye(4), np.zeros(6), 0.0, t_j, t, **covariance)


def known(**changed: Any) -> object:
    """What is known of one landmark, with something wrong."""
    given = {"number": [3], "seen": np.ones((1, 3)), "root": np.ones((1, 3, 3))}
    given |= {
        "R_cam_view": np.ones((1, 3, 3)),
        "rows": np.ones((1, 3, 13)),
        "T_world_cam": np.eye(4),
        "velocity": np.zeros(6),
    }
    return LandmarkPrior(**{**given, **changed})


CASES: list[tuple[str, Callable[[], object]]] = [
    ("number", lambda: known(number=[0.5])),
    ("seen", lambda: known(number=[1, 2])),
    ("R_cam_view", lambda: known(R_cam_view=np.eye(4)[None])),
    ("root", lambda: known(root=np.ones((1, 3, 2)))),
    ("rows", lambda: known(rows=np.ones((1, 3, 12)))),
    ("velocity", lambda: known(velocity=np.full(6, np.nan))),
    ("order", lambda: prior_covariance(4, 0.1, QC)),
    ("order", lambda: prior_square_root_information(1, 0.1, QC)),
    ("fx", lambda: StereoCamera("wide", 200, 160, 120, 0.1)),  # type: ignore[arg-type]
    ("baseline", lambda: StereoCamera(200, 200, 160, 120, 0.0)),
    ("dt", lambda: prior(dt=0.0)),
    ("dt", lambda: prior(dt=-1e-6)),
    ("dt", lambda: prior(dt=np.nan)),
    ("qc", lambda: prior(qc=np.ones(5))),
    ("qc", lambda: prior(qc=np.diag([1, 1, 1, 1, 1, -1.0]))),
    ("qc", lambda: prior(qc=np.zeros(6))),
    ("qc", lambda: prior(qc=np.eye(6) + np.eye(6, k=1))),
    ("qc", lambda: prior(qc=np.full(6, np.nan))),
    ("dt", lambda: wnoa_covariance(np.inf, QC)),
    ("measured", lambda: stereo(good[:2])),
    ("measured", lambda: stereo([np.nan, 1, 1])),
    ("measured", lambda: stereo(behind)),
    ("model", lambda: stereo(model=two)),
    ("model", lambda: stereo(model=1.0)),
    ("t = ", lambda: between(-0.01)),
    ("t = ", lambda: between(0.11)),
    ("t = ", lambda: between(np.nan)),
    ("measured", lambda: between(measured=behind)),
    ("model", lambda: between(model=two)),
    ("qc", lambda: between(qc=-QC)),
    ("dt", lambda: fast(dt=0.0)),
    ("point", lambda: fast(point=(0, 0))),
    ("measured", lambda: fast(measured=(0, 0, np.inf))),
    ("point", lambda: iterative(point=(0, 0, -1))),
    ("dt", lambda: iterative(dt=-0.1)),
    ("measured", lambda: iterative(measured=behind)),
    ("t must", lambda: query(0.2)),
    ("t must", lambda: query(np.nan)),
    ("t_i before t_j", lambda: query(0.0, 0.0)),
    ("v_i", lambda: query(v_i=np.zeros(5))),
    ("v_i", lambda: query(v_i=np.full(6, np.nan))),
    ("qc", lambda: query(joint_covariance=np.eye(24))),
    ("joint_covariance", lambda: query(qc=QC, joint_covariance=np.eye(12))),
    ("positive semidefinite", lambda: query(qc=QC, joint_covariance=-np.eye(24))),
    ("dt", lambda: extrapolate(np.eye(4), np.zeros(6), np.nan)),
    ("T_i", lambda: extrapolate(np.eye(3), np.zeros(6), 0.1)),
    ("qc", lambda: extrapolate(np.eye(4), np.zeros(6), 0.1, None, np.eye(12))),
    ("fx", lambda: StereoCamera(-1, 1, 0, 0, 0.1)),
    ("cx", lambda: StereoCamera(1, 1, np.nan, 0, 0.1)),
    ("T_i must be poses", lambda: extrapolate(2 * np.eye(4), np.zeros(6), 0.1)),
    ("T_i must be poses", lambda: extrapolate(np.diag([1, 1, -1, 1]), np.zeros(6), 0.1)),
    ("T must be poses", lambda: se3_log(np.ones((4, 4)))),
    ("T must be poses", lambda: se3_inverse(np.stack([np.eye(4), sheared]))),
    ("T_j must be poses", lambda: wnoa_error(np.eye(4), np.zeros(6), sheared, np.zeros(6), 0.1)),
    ("v_i", lambda: wnoa_error(np.eye(4), np.zeros(3), np.eye(4), np.zeros(6), 0.1)),
    ("T_body_cam must be poses", lambda: stereo(T_body_cam=2 * np.eye(4))),
    ("T_body_cam", lambda: stereo(T_body_cam=np.eye(3))),
    ("T_body_cam", lambda: stereo(T_body_cam=np.eye(4)[None])),
    ("camera", lambda: stereo(camera=5)),
    ("skew", lambda: stereo(camera=gtsam.Cal3_S2Stereo(1, 1, 0.1, 0, 0, 0.1))),
    ("Constrained", lambda: stereo(model=gtsam.noiseModel.Constrained.All(3))),
    ("Constrained", lambda: between(model=gtsam.noiseModel.Constrained.All(3))),
    ("Constrained", lambda: tracklet(gtsam.noiseModel.Constrained.All(3))),
    ("Constrained", lambda: tracklet(robust(gtsam.noiseModel.Constrained.All(3)))),
    ("states", lambda: tracklet(states=[(X(0), V(0)), (X(1), V(1), 0.1)])),
    ("state_i", lambda: WnoaPriorFactor((X(0), V(0)), (X(1), V(1), 0.1), QC)),
    ("state_j must be later", lambda: WnoaPriorFactor(*reversed(STATES), QC)),
    ("measured", lambda: stereo(gtsam.StereoPoint2(6, 180, 120))),
    ("rows", lambda: LinearStatesFactor([X(0), V(0)], [np.eye(4)], np.zeros((1, 6)), np.eye(6))),
    ("baseline", lambda: StereoCamera(1, 1, 0, 0, 0.0)),
]


@pytest.mark.parametrize(("name", "call"), CASES)
def test_the_argument_is_named(name: str, call: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=name):
        call()
