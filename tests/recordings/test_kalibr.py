"""The rig of a camchain: geometry against independent formulas, and every fault of the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from recording_files import camchain
from scipy.spatial.transform import Rotation

from gpvo.errors import InputError
from gpvo.recordings import Camera, StereoRig, open_recording, read_kalibr

Write = Callable[[Any], Path]


def distort(camera: Camera, rays: np.ndarray) -> np.ndarray:
    """Return raw pixels (N, 2) of rays (N, 3) in the raw camera frame, by Kannala and Brandt."""
    x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
    r, d = np.hypot(x, y), camera.distortion
    if camera.distortion_model == "equidistant":
        theta = np.arctan(r)
        radius = theta * (1 + d[0] * theta**2 + d[1] * theta**4 + d[2] * theta**6 + d[3] * theta**8)
        bent = np.stack([x, y]) * radius / r
    else:
        radial = 1 + d[0] * r**2 + d[1] * r**4
        bent = np.stack(
            [
                x * radial + 2 * d[2] * x * y + d[3] * (r**2 + 2 * x**2),
                y * radial + d[2] * (r**2 + 2 * y**2) + 2 * d[3] * x * y,
            ]
        )
    return bent.T * camera.intrinsics[:2] + camera.intrinsics[2:]


def rays_of(rectified: np.ndarray, rig: StereoRig, camera: Camera) -> np.ndarray:
    """Return rays (N, 3) in the raw camera frame of rectified pixels (N, 2)."""
    points = (rectified - rig.principal_point) / rig.focal_length
    return np.column_stack([points, np.ones(len(points))]) @ camera.R_rect


MODELS = {
    "equidistant": [-0.05, 0.01, -0.05, 0.02],
    "radtan": [-0.2, 0.05, 0.001, -0.002],
    "none": [],
}


@pytest.fixture(params=MODELS)
def rig(request: pytest.FixtureRequest, write_camchain: Write) -> StereoRig:
    content = camchain()
    for camera in content.values():
        camera |= {"distortion_model": request.param, "distortion_coeffs": MODELS[request.param]}
    return read_kalibr(write_camchain(content))


def test_tables_undo_the_distortion(rig: StereoRig) -> None:
    """Projecting the ray of a table's entry through the lens gives back the raw pixel."""
    for camera, table in zip((rig.left, rig.right), rig.tables, strict=True):
        rows, columns = np.mgrid[0 : camera.resolution[1], 0 : camera.resolution[0]]
        raw = np.column_stack([columns.ravel(), rows.ravel()])
        rays = rays_of(table.reshape(-1, 2).astype(np.float64), rig, camera)
        np.testing.assert_allclose(distort(camera, rays), raw, rtol=0, atol=2e-2)


@pytest.mark.parametrize(
    ("model", "coefficients", "told"),
    [("fisheye", 0.0, "equidistant, radtan, none"), ("none", 0.1, "no coefficients")],
)
def test_a_lens_that_does_not_exist_is_refused(model: Any, coefficients: float, told: str) -> None:
    with pytest.raises(InputError, match=f"distortion.*{told}"):
        Camera((64, 48), np.array([40.0, 40, 32, 24]), model, np.full(4, coefficients), np.eye(3))


def test_a_point_lies_on_one_rectified_row(rig: StereoRig) -> None:
    """Points projected to both raw images have disparity f b / Z and equal rectified rows."""
    content = camchain()
    T_right_left = np.array(content["cam1"]["T_cn_cnm1"])
    points = np.random.default_rng(0).uniform([-0.5, -0.3, 1.0], [0.5, 0.3, 4.0], (50, 3))
    raw_right = distort(rig.right, points @ T_right_left[:3, :3].T + T_right_left[:3, 3])
    left = rig.left.rectify_points(distort(rig.left, points), rig.K_rect)
    right = rig.right.rectify_points(raw_right, rig.K_rect)
    Z = (points @ rig.left.R_rect.T)[:, 2]
    np.testing.assert_allclose(left[:, 1], right[:, 1], rtol=0, atol=1e-3)
    disparity = rig.focal_length * rig.baseline / Z
    np.testing.assert_allclose(left[:, 0] - right[:, 0], disparity, rtol=0, atol=1e-3)
    assert rig.baseline == pytest.approx(np.linalg.norm(T_right_left[:3, 3]), abs=1e-12)


def test_rectification_of_the_file_comes_first(rig: StereoRig, write_camchain: Write) -> None:
    content = camchain()
    half = np.diag([20.0, 20.0, 1.0])
    half[:2, 2] = rig.principal_point
    for camera, lens, offset in zip(
        content.values(), (rig.left, rig.right), (0.0, -2.08), strict=True
    ):
        camera["rectification_matrix"] = lens.R_rect.tolist()
        camera["projection_matrix"] = np.column_stack([half, [offset, 0.0, 0.0]]).tolist()
    ours = read_kalibr(write_camchain(content))
    assert (ours.focal_length, ours.baseline) == (20.0, pytest.approx(0.104, abs=1e-15))
    assert ours.principal_point == rig.principal_point
    np.testing.assert_array_equal(ours.left.R_rect, rig.left.R_rect)


@pytest.mark.parametrize("factor", [-1.0, 1.3])
def test_extrinsics_that_contradict_the_projections_are_refused(
    rig: StereoRig, write_camchain: Write, factor: float
) -> None:
    """The sign of T_cn_cnm1 is easily mistaken; both cannot be right."""
    content = camchain()
    for camera, lens, offset in zip(
        content.values(), (rig.left, rig.right), (0.0, -2.0), strict=True
    ):
        camera["rectification_matrix"] = lens.R_rect.tolist()
        half = np.array([[20.0, 0, 32, offset], [0, 20.0, 24, 0], [0, 0, 1, 0]])
        camera["projection_matrix"] = half.tolist()
    read_kalibr(write_camchain(content))
    T = np.array(content["cam1"]["T_cn_cnm1"])
    T[:3, 3] *= factor
    content["cam1"]["T_cn_cnm1"] = T.tolist()
    with pytest.raises(InputError, match="cam1/T_cn_cnm1 contradicts projection_matrix"):
        read_kalibr(write_camchain(content))


def test_indoor_flying(shared: Path, write_camchain: Write) -> None:
    path = shared / "recordings/camchain-imucam-indoor_flying.yaml"
    rig = read_kalibr(path)
    assert rig.focal_length == pytest.approx(199.6530123, abs=1e-7)
    assert rig.principal_point == pytest.approx((177.4327638, 126.8121568), abs=1e-7)
    assert rig.baseline == pytest.approx(0.0998821, abs=1e-7)
    assert rig.left.resolution == rig.right.resolution == (346, 260)
    content = yaml.safe_load(path.read_text())
    for name in ("cam0", "cam1"):
        del content[name]["rectification_matrix"], content[name]["projection_matrix"]
    computed = read_kalibr(write_camchain(content))
    np.testing.assert_allclose(computed.left.R_rect, rig.left.R_rect, atol=1e-9)
    np.testing.assert_allclose(computed.right.R_rect, rig.right.R_rect, atol=1e-9)
    assert computed.baseline == pytest.approx(rig.baseline, abs=1e-9)


def edited(camera: str, field: str, value: object) -> dict[str, Any]:
    content = camchain()
    content[camera][field] = value
    return content


def without(camera: str, field: str) -> dict[str, Any]:
    content = camchain()
    del content[camera][field]
    return content


def rectified(camera: str, field: str, value: object) -> dict[str, Any]:
    content = camchain()
    for name, offset in (("cam0", 0.0), ("cam1", -2.0)):
        P = [[20.0, 0.0, 32.0, offset], [0.0, 20.0, 24.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
        content[name] |= {"rectification_matrix": np.eye(3).tolist(), "projection_matrix": P}
    content[camera][field] = value
    return content


def beside(x: float, y: float, z: float = 0.0) -> list[list[float]]:
    """Return T_cn_cnm1 of parallel cameras."""
    return [[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]]


def turned(axis: str, degrees: float) -> list[list[float]]:
    """Return T_cn_cnm1 of a right camera that is turned about one of the left one's axes."""
    T = np.array(beside(-0.1, 0.0))
    T[:3, :3] = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return T.tolist()


def radtan(x: float, y: float, z: float) -> dict[str, Any]:
    """Return a camchain of parallel pinhole cameras, the right one moved by T_cn_cnm1."""
    content = edited("cam1", "T_cn_cnm1", beside(x, y, z))
    for camera in content.values():
        camera["distortion_model"] = "radtan"
    return content


OTHER_F = [[21.0, 0.0, 32.0, -2.0], [0.0, 21.0, 24.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
NOT_RIGHT = [[20.0, 0.0, 32.0, 2.0], [0.0, 20.0, 24.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
FAULTS = [
    ("", "cam0"),
    ("[1, 2]", "cam0"),
    ("cam0: [1, 2", "line 1"),
    ("[" * 500, "YAML"),
    ("cam0: !!bool perhaps", "YAML"),
    ("cam0: !!python/object/apply:os.getcwd []", "YAML"),
    ({"cam0": camchain()["cam0"]}, "cam1 is missing"),
    ({"cam0": 3, "cam1": 4}, "cam0 must hold"),
    (without("cam1", "intrinsics"), "cam1/intrinsics is missing"),
    (without("cam0", "resolution"), "cam0/resolution is missing"),
    (without("cam1", "T_cn_cnm1"), "cam1/T_cn_cnm1 is missing"),
    (edited("cam0", "camera_model", "omni"), "cam0/camera_model"),
    (edited("cam0", "distortion_model", "fov"), "cam0/distortion_model"),
    (edited("cam0", "distortion_model", ["radtan"]), "cam0/distortion_model"),
    (edited("cam1", "distortion_model", "radtan"), "cam1/distortion_model"),
    (edited("cam0", "distortion_coeffs", [0.1, 0.2]), "cam0/distortion_coeffs must be 4 numbers"),
    (edited("cam0", "intrinsics", [40.0, 40.0, 32.0, float("nan")]), "cam0/intrinsics"),
    (edited("cam0", "intrinsics", [40.0, "wide", 32.0, 24.0]), "cam0/intrinsics"),
    (edited("cam0", "intrinsics", [40.0, [1.0], 32.0, 24.0]), "cam0/intrinsics"),
    (edited("cam0", "intrinsics", [0.0, 40.0, 32.0, 24.0]), "cam0/intrinsics"),
    (edited("cam0", "intrinsics", None), "cam0/intrinsics"),
    (
        edited("cam0", "intrinsics", [1e-3, 1e-3, 32.0, 24.0]),
        "cam0/intrinsics has the focal length",
    ),
    (
        edited("cam1", "intrinsics", [1e30, 1e30, 32.0, 24.0]),
        "cam1/intrinsics has the focal length",
    ),
    (edited("cam1", "intrinsics", [42.0, 42.0, 3200.0, 24.0]), "cam1/intrinsics has the principal"),
    (edited("cam1", "T_cn_cnm1", turned("y", 180)), "cam1/T_cn_cnm1 turns the left camera by"),
    (edited("cam1", "T_cn_cnm1", turned("x", 90)), "cam1/T_cn_cnm1 turns the left camera by 45"),
    (edited("cam1", "resolution", [64.5, 48]), "cam1/resolution"),
    (edited("cam1", "resolution", [0, 48]), "cam1/resolution"),
    (edited("cam1", "resolution", [64, 1e9]), "cam1/resolution"),
    (edited("cam1", "T_cn_cnm1", (2 * np.eye(4)).tolist()), "cam1/T_cn_cnm1 is not a rotation"),
    (edited("cam1", "T_cn_cnm1", beside(0.1, 0.0)), "cam1/T_cn_cnm1 gives no positive baseline"),
    (edited("cam1", "T_cn_cnm1", beside(0.0, -0.1)), "cam1/T_cn_cnm1 does not place"),
    (edited("cam1", "T_cn_cnm1", beside(0.0, 0.0)), "cam1/T_cn_cnm1 does not place"),
    (edited("cam1", "T_cn_cnm1", beside(-100.0, 0.0)), "gives a baseline of 100 m: lengths must"),
    (radtan(0.0, 0.0, 0.0), "cam1/T_cn_cnm1 does not place"),
    (radtan(0.0, 0.0, -0.1), "cam1/T_cn_cnm1 does not place"),
    (radtan(-0.1, 0.0, -0.2), "cam1/T_cn_cnm1 does not place"),
    (edited("cam0", "rectification_matrix", np.eye(3).tolist()), "cam1/rectification_matrix"),
    (rectified("cam1", "rectification_matrix", np.diag([-1, 1, -1]).tolist()), "camera by 180"),
    (rectified("cam0", "rectification_matrix", np.ones((3, 3)).tolist()), "cam0/rectification"),
    (rectified("cam0", "rectification_matrix", (-np.eye(3)).tolist()), "cam0/rectification"),
    (rectified("cam1", "projection_matrix", np.eye(3).tolist()), "cam1/projection_matrix"),
    (rectified("cam1", "projection_matrix", OTHER_F), "cam1/projection_matrix does not give"),
    (rectified("cam1", "projection_matrix", NOT_RIGHT), "cam1/projection_matrix gives no"),
]


@pytest.mark.parametrize(
    ("f", "cx", "problem"), [(20.0, 3200.0, "0 % of the left camera's pixels"), (0.1, 32.0, "0.1 ")]
)
def test_projections_that_show_nothing_are_refused(
    write_camchain: Write, f: float, cx: float, problem: str
) -> None:
    content = rectified("cam0", "resolution", [64, 48])
    for camera, offset in zip(content.values(), (0.0, -0.1 * f), strict=True):
        camera["projection_matrix"] = [[f, 0, cx, offset], [0, f, 24.0, 0], [0, 0, 1.0, 0]]
    with pytest.raises(InputError, match=f"cam1/projection_matrix .*{problem}"):
        read_kalibr(write_camchain(content))


@pytest.mark.parametrize(("content", "problem"), FAULTS, ids=range(len(FAULTS)))
def test_faults(content: object, problem: str, write_camchain: Write) -> None:
    path = write_camchain(content)
    with pytest.raises(InputError) as caught:
        read_kalibr(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unreadable_files(tmp_path: Path, recording_path: Path) -> None:
    for path in (tmp_path / "missing.yaml", tmp_path, recording_path):
        with pytest.raises(InputError, match=r"calibration|camchain") as caught:
            open_recording(recording_path, path)
        assert str(caught.value).startswith(f"{path}: ")
