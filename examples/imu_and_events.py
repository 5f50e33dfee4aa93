"""An IMU and event features in one graph: motion, gravity's direction and biases, also in the dark.

Landmarks are measured one by one, each at its own microsecond, as an event camera's features are;
for 0.4 s nothing is seen. The IMU measures at 500 Hz: preintegrated between states, and each rate
of its gyroscope at its own time. Run as ``python -m examples.imu_and_events``; with a file name it
also saves a plot.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X
from numpy.typing import NDArray

from factors import (
    GaussianProcess,
    GyroFactor,
    ImuFactor,
    InterpolatedFactor,
    StereoCamera,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    optimize,
)
from factors.lie import se3_exp, se3_inverse, se3_log

Array = NDArray[np.float64]

CAMERA = StereoCamera(fx=226.0, fy=226.0, cx=173.0, cy=130.0, baseline=0.1)
MOUNTED = gtsam.Pose3(gtsam.Rot3.Ypr(-1.57, 0.0, -1.57), np.array([0.05, 0.0, 0.1]))  # T_body_cam
PIXELS = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.3, 0.3, 0.4]))  # (u_left, v, disparity)
QC = np.array([2.0, 2.0, 2.0, 5.0, 5.0, 5.0])  # power spectral density of the acceleration
BIAS = gtsam.imuBias.ConstantBias(np.array([0.1, -0.05, 0.08]), np.array([0.02, -0.03, 0.01]))
GYRO = gtsam.noiseModel.Isotropic.Sigma(3, 0.01)  # rad/s
RATE = 500  # Hz
STATES = [(X(k), V(k), 0.05 * k) for k in range(25)]  # pose key, velocity key, seconds
DARK = (0.5, 0.9)  # seconds in which nothing is seen


def true_pose(t: Array) -> Array:
    """Poses T_world_body (n, 4, 4): forward, swinging; z is up."""
    swing = np.column_stack([0.2 * np.sin(3 * t), 0.1 * np.sin(4 * t), 0.3 * np.sin(2 * t)])
    move = np.column_stack([0.8 * t, 0.3 * np.sin(3 * t), 0.1 * np.cos(4 * t)])
    turned = se3_exp(np.column_stack([swing, np.zeros((len(t), 3))]))
    turned[:, :3, 3] = move
    return turned


def true_twist(t: Array, h: float = 1e-5) -> Array:
    """Body twists (n, 6), by differences."""
    return se3_log(se3_inverse(true_pose(t - h)) @ true_pose(t + h)) / (2 * h)


def inertial(t: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Specific forces and rates (n, 3) that the IMU, which is the body, measures."""
    h = 1e-4
    position = [true_pose(t + k * h)[:, :3, 3] for k in (-1, 0, 1)]
    acceleration = (position[0] - 2 * position[1] + position[2]) / h**2 + [0, 0, 9.81]
    force = np.einsum("nji,nj->ni", true_pose(t)[:, :3, :3], acceleration)
    noise = 0.02 * rng.normal(size=force.shape), 0.01 * rng.normal(size=force.shape)
    rate = true_twist(t)[:, :3]
    return force + BIAS.accelerometer() + noise[0], rate + BIAS.gyroscope() + noise[1]


def features(rng: np.random.Generator) -> StructurelessStereoFactor:
    """Sixty landmarks, each measured eight times within 0.3 s, the body's states given."""
    measured, times, landmarks = [], [], []
    for n in range(60):
        t = np.sort(rng.uniform(0, 0.9) + rng.uniform(0, 0.3, 8)).round(6)
        T_cam_world = se3_inverse(true_pose(t) @ MOUNTED.matrix())
        ray = np.array([*rng.uniform(-0.5, 0.5, 2), 1.0]) * rng.uniform(1.5, 5)
        point = se3_inverse(T_cam_world[:1])[0] @ [*ray, 1.0]
        seen = CAMERA.project((T_cam_world @ point)[:, :3]) + rng.normal(size=(8, 3)) * 0.3
        lit = (t < DARK[0]) | (t > DARK[1])
        measured.append(seen[lit])
        times.append(t[lit])
        landmarks.append(np.full(lit.sum(), n))
    return StructurelessStereoFactor(
        np.concatenate(measured),
        np.concatenate(times),
        np.concatenate(landmarks),
        PIXELS,
        STATES,
        CAMERA,
        T_body_cam=MOUNTED,
    )


def add_imu(graph: gtsam.NonlinearFactorGraph, rng: np.random.Generator) -> None:
    """Preintegrated measurements between states, and every fifth rate at its own time."""
    parameters = gtsam.PreintegrationParams.MakeSharedU(9.81)
    parameters.setAccelerometerCovariance(np.eye(3) * 0.02**2 / RATE)
    parameters.setGyroscopeCovariance(np.eye(3) * 0.01**2 / RATE)
    parameters.setIntegrationCovariance(np.eye(3) * 1e-8)
    for state_i, state_j in pairwise(STATES):
        edges = np.linspace(state_i[2], state_j[2], round(0.05 * RATE) + 1)
        t = (edges[:-1] + edges[1:]) / 2
        force, rate = inertial(t, rng)
        summed = gtsam.PreintegratedImuMeasurements(parameters)
        for n in range(len(t)):
            summed.integrateMeasurement(force[n], rate[n], edges[n + 1] - edges[n])
        graph.add(ImuFactor(summed, state_i, state_j, B(0)))
        for n in range(2, len(t), 5):
            gyro = GyroFactor(rate[n], GYRO, velocity=0, bias=B(0))  # 0 stands for the twist at t
            graph.add(InterpolatedFactor(gyro, state_i, state_j, t[n], velocity=0))


def solve(with_imu: bool) -> tuple[GaussianProcess, gtsam.Values]:
    """Solve for the motion, from rest at the first pose."""
    graph, values, rng = gtsam.NonlinearFactorGraph(), gtsam.Values(), np.random.default_rng(0)
    first = gtsam.Pose3(true_pose(np.zeros(1))[0])
    graph.add(gtsam.PriorFactorPose3(X(0), first, gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)))
    for state_i, state_j in pairwise(STATES):
        graph.add(WnoaPriorFactor(state_i, state_j, QC))
    graph.add(features(rng))
    for pose, velocity, _ in STATES:
        values.insert(pose, first)
        values.insert(velocity, np.zeros(6))
    if with_imu:
        add_imu(graph, rng)
        values.insert(B(0), gtsam.imuBias.ConstantBias())
    solved = optimize(graph, values, gtsam.LevenbergMarquardtParams())
    return GaussianProcess(STATES, solved, QC), solved


def main(plot: Path | None = None) -> tuple[Array, Array, gtsam.imuBias.ConstantBias]:
    """Return the errors (n, 6) of features alone and with the IMU, and its bias as estimated."""
    t = np.linspace(0, STATES[-1][2], 241)
    alone, (helped, values) = solve(False)[0], solve(True)
    errors = [se3_log(se3_inverse(true_pose(t)) @ each.pose(t)) for each in (alone, helped)]
    for name, error in zip(("features alone", "with the IMU"), errors, strict=True):
        largest = np.linalg.norm(error[:, 3:], axis=1).max()
        print(f"{name}: largest position error {1e3 * largest:.0f} mm")
    if plot:
        save_plot(plot, t, *errors)
    return errors[0], errors[1], values.atConstantBias(B(0))


def save_plot(path: Path, t: Array, alone: Array, helped: Array) -> None:
    """Position errors of both, and when it is dark."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3), layout="constrained")
    axes = figure.subplots()
    axes.axvspan(*DARK, color="0.93", label="nothing seen")
    for name, error in (("features alone", alone), ("with the IMU", helped)):
        axes.semilogy(t, 1e3 * np.linalg.norm(error[:, 3:], axis=1) + 1e-3, label=name)
    axes.set(xlabel="time (s)", ylabel="position error (mm)", ylim=(0.1, None))
    axes.legend(frameon=False)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
