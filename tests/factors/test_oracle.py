"""The factors against an 80-bit reference, in 24 cases of 10 us to 0.5 s and up to 2.2 rad.

Everything is seen from state i, T_i = 1: at 10 us the rounding of two double poses T_i and T_j in
another frame would already be 1e-11 of their difference.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray

from factors import interpolate
from factors.wnoa import wnoa_error

Array = NDArray[np.float64]

ORACLE = Path(__file__).parents[3] / "shared" / "oracle" / "oracle_wnoa.npz"
CASES = range(24)


class Oracle:
    """Case n of the oracle in GTSAM's convention.

    With left perturbations d_s of T_s = T_g^-1: T_g = T_s^-1, d_g = -P d_s, v_g = -P v_s.
    """

    def __init__(self, n: int) -> None:
        with np.load(ORACLE) as file:
            case = {name: file[name][n] for name in file.files if name not in ("P", "conventions")}
            P = file["P"]
        P2, P4 = np.kron(np.eye(2), P), np.kron(np.eye(4), P)
        self.dt, self.tau, self.qc = case["dt"], case["tau"], P @ case["Qc_s"]
        self.T_i, self.T_j = np.eye(4), relative(case["T1_s"], case["T2_s"])
        self.v_i, self.v_j = -P @ case["w1_s"], -P @ case["w2_s"]
        self.error, self.jacobian = -P2 @ case["e_ref_s"], P2 @ case["J_ref_s"] @ P4.T
        self.covariance, self.information = case["Qk_g"], P2 @ case["Qinv_s"] @ P2.T
        self.pose = relative(case["T1_s"], case["Ttau_ref_s"])
        self.velocity = -P @ case["wtau_ref_s"]
        self.prior_covariance = block_diagonal([P @ c @ P.T for c in case["prior_cov_s"]])
        self.by_states = P2 @ np.vstack([case["JT_ref_s"], case["Jw_ref_s"]]) @ P4.T


def block_diagonal(blocks: list[Array]) -> Array:
    return np.asarray(scipy.linalg.block_diag(*blocks))


def relative(T_i_world: Array, T_j_world: Array) -> Array:
    """T_i_j, by way of T_j_i in extended precision as the reference has it.

    The poses are orthonormal to 1e-16 only, so that another order would give another rotation.
    """
    T_world_i = rigid_inverse(T_i_world.astype(np.longdouble))
    return rigid_inverse(T_j_world.astype(np.longdouble) @ T_world_i).astype(np.float64)


def rigid_inverse(T: NDArray[np.longdouble]) -> NDArray[np.longdouble]:
    inverse = T.copy()
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -inverse[:3, :3] @ T[:3, 3]
    return inverse


@pytest.fixture(params=CASES)
def oracle(request: pytest.FixtureRequest) -> Oracle:
    if not ORACLE.exists():
        pytest.skip("the oracle is not part of this repository")
    return Oracle(request.param)


def relative_difference(actual: Array, expected: Array) -> float:
    return float(np.abs(actual - expected).max() / np.abs(expected).max())


def test_prior(oracle: Oracle) -> None:
    error, jacobian = wnoa_error(oracle.T_i, oracle.v_i, oracle.T_j, oracle.v_j, oracle.dt)
    assert relative_difference(error, oracle.error) < 1e-12
    assert relative_difference(jacobian, oracle.jacobian) < 1e-12


def test_interpolated_mean(oracle: Oracle) -> None:
    state = interpolate(oracle.T_i, oracle.v_i, oracle.T_j, oracle.v_j, 0.0, oracle.dt, oracle.tau)
    assert relative_difference(state.pose, oracle.pose) < 1e-12
    assert relative_difference(state.velocity, oracle.velocity) < 1e-12
