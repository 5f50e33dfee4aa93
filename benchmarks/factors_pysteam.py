"""The standard problem solved by asrl-pysteam, if it is installed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from gtsam.symbol_shorthand import L, V, X

from benchmarks.factors_problem import CAMERA, QC, SIGMAS, Problem
from factors.lie import se3_inverse


def pysteam_step(problem: Problem) -> Callable[[], object] | None:
    """One Gauss-Newton step of asrl-pysteam on the same problem, if it is installed.

    Its convention is that of the paper: world to camera, translation first.
    """
    try:
        from pylgmath import Transformation
        from pysteam.evaluable.se3 import SE3StateVar
        from pysteam.evaluable.stereo import (
            CameraIntrinsics,
            ComposeLandmarkEvaluator,
            HomoPointStateVar,
            StereoErrorEvaluator,
        )
        from pysteam.evaluable.vspace import VSpaceStateVar
        from pysteam.problem import (
            L2LossFunc,
            OptimizationProblem,
            StaticNoiseModel,
            WeightedLeastSquareCostTerm,
        )
        from pysteam.solver import GaussNewtonSolver
        from pysteam.trajectory import Time
        from pysteam.trajectory.const_vel import Interface
    except ImportError:
        return None
    swap = np.roll(np.eye(6), 3, axis=0)
    start, trajectory, opt = problem.start, Interface(qcd=swap @ QC), OptimizationProblem()
    points = [
        HomoPointStateVar(np.r_[start.atPoint3(L(n)), 1.0][:, None])
        for n in range(len(problem.points))
    ]
    u, v, disparity = problem.measured.T
    measured = np.stack([u, v, u - disparity, v], axis=-1)[..., None]
    sigmas = SIGMAS[[0, 1, 2, 1]] * [1, np.sqrt(2), 1, np.sqrt(2)]
    noise, loss = StaticNoiseModel(np.diag(sigmas**2)), L2LossFunc()
    intrinsics = CameraIntrinsics(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, CAMERA.baseline)
    poses = []
    for k, t in enumerate(problem.times):
        T_camera_world = Transformation(T_ba=se3_inverse(start.atPose3(X(k)).matrix()))
        poses.append(SE3StateVar(T_camera_world))
        velocity = VSpaceStateVar(-swap @ start.atVector(V(k))[:, None])
        trajectory.add_knot(time=Time(t), T_k0=poses[k], w_0k_ink=velocity)
        opt.add_state_var(poses[k], velocity)
    opt.add_state_var(*points)
    first = Transformation(T_ba=se3_inverse(problem.truth[0]))
    trajectory.add_pose_prior(Time(problem.times[0]), first, 1e-6 * np.eye(6))
    opt.add_cost_term(*trajectory.get_prior_cost_terms())
    for k, n in enumerate(problem.landmark):
        seen = ComposeLandmarkEvaluator(poses[k], points[n])
        error = StereoErrorEvaluator(measured[k], intrinsics, seen)
        opt.add_cost_term(WeightedLeastSquareCostTerm(error, noise, loss))
    solver = GaussNewtonSolver(opt)
    return solver.linearize_solve_and_update
