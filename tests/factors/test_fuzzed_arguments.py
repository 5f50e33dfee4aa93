"""Constructors with one argument of any wrong kind: refused by its name, or a factor that works."""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import CAMERA, NOISE
from gtsam.symbol_shorthand import B, L, V, X

from factors import (
    EuclideanVelocityFactor,
    GyroFactor,
    ImuFactor,
    InterpolatedFactor,
    InterpolatedStereoFactor,
    LinearStatesFactor,
    PointToPlaneFactor,
    PointToPointFactor,
    ReprojectionVelocityFactor,
    StereoReprojectionFactor,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    WnoaPriorFactorVector,
    WnojPriorFactorPose2,
)

ONE, THREE = (gtsam.noiseModel.Isotropic.Sigma(n, 0.1) for n in (1, 3))
STATES = {f"state_{end}": gtsam.StateData(X(k), V(k), 0.1 * k) for k, end in enumerate("ij")}
KEYS = {"pose_i": X(0), "velocity_i": V(0), "pose_j": X(1), "velocity_j": V(1)}
IMU = gtsam.PreintegratedImuMeasurements(gtsam.PreintegrationParams.MakeSharedU(9.81))
IMU.integrateMeasurement(np.array([0, 0, 9.81]), np.zeros(3), 0.1)
SEEN = np.array([180.0, 120.0, 6.0])
CAMERA_OF = {"model": NOISE, "landmark": L(0), "camera": CAMERA}
GOOD: list[tuple[Any, dict[str, Any]]] = [
    (WnoaPriorFactor, {**KEYS, "dt": 0.1, "qc": np.ones(6)}),
    (WnoaPriorFactor, {**STATES, "qc": np.ones(6)}),
    (WnoaPriorFactorVector, {**KEYS, "dt": 0.1, "qc": np.ones(2)}),
    (
        WnojPriorFactorPose2,
        {**KEYS, "acceleration_i": 1, "acceleration_j": 2, "dt": 0.1, "qc": np.ones(3)},
    ),
    (InterpolatedStereoFactor, {"measured": SEEN, **STATES, **CAMERA_OF, "t": 0.05}),
    (
        InterpolatedStereoFactor,
        {"measured": SEEN, **KEYS, **CAMERA_OF, "t_i": 0.0, "t_j": 0.1, "t": 0.05},
    ),
    (StereoReprojectionFactor, {"measured": SEEN, **CAMERA_OF, "pose": X(0), "T_body_cam": None}),
    (
        InterpolatedFactor,
        {"inner": gtsam.GPSFactor(0, SEEN, THREE), **STATES, "t": 0.05, "pose": 0, "qc": None},
    ),
    (PointToPointFactor, {"measured": SEEN, "target": SEEN, "model": THREE, "pose": X(0)}),
    (
        PointToPlaneFactor,
        {"measured": SEEN, "normal": np.eye(3)[0], "distance": 1.0, "model": ONE, "pose": X(0)},
    ),
    (
        GyroFactor,
        {"measured": SEEN, "model": THREE, "velocity": V(0), "bias": B(0), "T_body_imu": None},
    ),
    (ImuFactor, {"preintegrated": IMU, **STATES, "bias": B(0)}),
    (
        EuclideanVelocityFactor,
        {"measured": SEEN, "model": THREE, "velocity": V(0), "point": SEEN, "dt": 0.1},
    ),
    (
        ReprojectionVelocityFactor,
        {"measured": SEEN, "model": THREE, "velocity": V(0), "point": SEEN, "dt": 0.1}
        | {"camera": CAMERA},
    ),
    (
        LinearStatesFactor,
        {"keys": [X(0), V(0)], "T_states": np.eye(4)[None], "v_states": np.zeros((1, 6))}
        | {"rows": np.ones((3, 13))},
    ),
    (
        StructurelessStereoFactor,
        {"measured": np.array([SEEN, SEEN + 1]), "times": [0.0, 0.1], "landmarks": 1}
        | {"model": NOISE, "states": list(STATES.values()), "camera": CAMERA, "tolerance": 1e-4}
        | {"qc": None, "prior": None, "T_body_cam": None},
    ),
]
WRONG: list[Any] = [
    *(None, "x", b"x", np.nan, np.inf, -1, -1.5, 1.5, 2**64, 2**70, 1j, [], {}, object()),
    *([np.nan] * 3, np.full(6, np.nan), np.ones((6, 6)), np.zeros((2, 2)), np.ones(3) * 1j),
    *(np.array(["a"]), 2 * np.eye(4), (1, 2), (X(0), V(0), np.nan), ("a", "b", 1.0), print),
    *(gtsam.Pose3(), gtsam.Rot3(), gtsam.StereoPoint2(1, 2, 1), STATES["state_i"]),
    *(gtsam.noiseModel.Unit.Create(6), gtsam.noiseModel.Constrained.All(3)),
]
ALSO_NAMED = {  # what it has to fit, or, of a list that is no list, Python's own error
    "keys": ["iterable"],
    "states": ["iterable"],
    "T_states": ["keys"],
    "v_states": ["keys"],
    **{
        name: ["t = ", "time", "later", "last", "dt", "pose_"]
        for name in ("t", "t_i", "t_j", *STATES)
    },
    **{name: [f"state_{name[-1]}"] for name in KEYS},
}


each_kind = pytest.mark.parametrize(
    ("kind", "arguments"), GOOD, ids=[f"{kind.__name__}{n}" for n, (kind, _) in enumerate(GOOD)]
)


@each_kind
def test_a_wrong_argument_is_refused_by_name(kind: Any, arguments: dict[str, Any]) -> None:
    kind(**arguments)
    for name in arguments:
        named = [name, *ALSO_NAMED.get(name, [])]
        for wrong in WRONG:
            try:
                made = kind(**{**arguments, name: wrong})
            except (ValueError, TypeError) as error:
                assert any(word in str(error) for word in named), (name, wrong, error)
                continue
            assert wrong is not None or arguments[name] is None or kind is InterpolatedFactor
            assert kind.__name__ in repr(made)
            numbers = [each for each in made._made_of.values() if isinstance(each, np.ndarray)]
            assert all(np.isfinite(each).all() for each in numbers), (name, wrong)
            assert wrong is None or name not in (*KEYS, "pose", "bias", "landmark"), (name, wrong)


@each_kind
def test_arrays_that_are_handed_over_may_change_afterwards(
    kind: Any, arguments: dict[str, Any]
) -> None:
    mine = {name: np.copy(a) if isinstance(a, np.ndarray) else a for name, a in arguments.items()}
    mine |= {name: np.eye(4) for name in arguments if name.startswith("T_body")}
    if kind is StructurelessStereoFactor:
        mine["qc"] = None
    factor, values = kind(**mine), gtsam.Values()
    for k in range(2):
        plane = kind is WnojPriorFactorPose2
        values.insert(X(k), gtsam.Pose2() if plane else gtsam.Pose3())
        size = {WnoaPriorFactorVector: 2, WnojPriorFactorPose2: 3}.get(kind, 6)
        values.insert(V(k), np.full(size, 0.1 + k))
        values.insert(1 + k, np.full(size, 0.2 - k))
    if kind is WnoaPriorFactorVector:
        for k in range(2):
            values.erase(X(k))
            values.insert(X(k), np.ones(2))
    values.insert(L(0), np.array([0.1, -0.2, 3.0]))
    values.insert(B(0), gtsam.imuBias.ConstantBias())
    before = factor.linearize(values).augmentedJacobian()
    for array in mine.values():
        if isinstance(array, np.ndarray):
            array *= 1.5
    np.testing.assert_array_equal(factor.linearize(values).augmentedJacobian(), before)
