"""The trajectory: asked anywhere, saved and exported without loss."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from runs import estimate
from synthetic import TWIST, constant_velocity, tracklets

from factors.lie import se3_exp, se3_inverse, se3_log
from gpvo.errors import InputError
from gpvo.trajectory import States, Trajectory, read_tum


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    return estimate(tracklets(noise=0.3), method="fixed_lag")


def test_first_pose_is_the_world(trajectory: Trajectory) -> None:
    assert np.allclose(trajectory.pose(trajectory.start), np.eye(4), atol=1e-12)


def test_at_a_state_it_is_the_state(trajectory: Trajectory) -> None:
    assert np.allclose(trajectory.pose(trajectory.t), trajectory.T_world_cam, atol=1e-12)
    assert np.allclose(trajectory.velocity(trajectory.t), trajectory.twist, atol=1e-9)


def test_velocity_is_the_derivative_of_the_pose(trajectory: Trajectory) -> None:
    rng = np.random.default_rng(0)
    i = rng.choice(np.flatnonzero(np.diff(trajectory.t) > 1e-4), 10)
    t, step = 0.5 * (trajectory.t[i] + trajectory.t[i + 1]), 1e-6
    between = se3_inverse(trajectory.pose(t - step)) @ trajectory.pose(t + step)
    assert np.allclose(se3_log(between) / (2 * step), trajectory.velocity(t), atol=1e-5)


def test_scalars_and_any_shape_of_times(trajectory: Trajectory) -> None:
    times = np.linspace(trajectory.start, trajectory.stop, 6).reshape(2, 3)
    assert trajectory.pose(times).shape == (2, 3, 4, 4)
    assert trajectory.velocity(times).shape == (2, 3, 6)
    assert trajectory.covariance(times).shape == (2, 3, 12, 12)
    for query in (trajectory.pose, trajectory.velocity, trajectory.covariance):
        assert np.array_equal(query(times)[1, 2], query(float(times[1, 2])))


@pytest.mark.parametrize("offset", [-0.01, 10.0, np.nan])
def test_times_outside_are_rejected(trajectory: Trajectory, offset: float) -> None:
    t = [trajectory.start, trajectory.start + offset]
    for query in (trajectory.pose, trajectory.velocity, trajectory.covariance):
        with pytest.raises(InputError, match=r"^t\b"):
            query(t)


def test_extrapolation_goes_on_at_constant_velocity(trajectory: Trajectory) -> None:
    ahead = trajectory.pose(trajectory.stop + 0.1, extrapolation=True)
    expected = trajectory.T_world_cam[-1] @ se3_exp(0.1 * trajectory.twist[-1])
    assert np.allclose(ahead, expected, atol=1e-12)
    t = trajectory.stop + np.array([0.0, 0.05, 0.1])
    spread = np.diagonal(trajectory.covariance(t, extrapolation=True)[:, 6:, 6:], 0, 1, 2)
    assert (np.diff(spread, axis=0) > 0).all()


@settings(deadline=None, max_examples=30)
@given(st.floats(0, 1))
def test_covariances_are_positive_definite(trajectory: Trajectory, part: float) -> None:
    t = trajectory.start + part * (trajectory.stop - trajectory.start)
    covariance = trajectory.covariance(t)
    assert np.array_equal(covariance, covariance.T)
    scale = np.sqrt(np.diagonal(covariance))
    assert np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() > 0


def test_a_state_between_others_changes_nothing() -> None:
    t = np.linspace(0, 1, 11)
    states = States(t, constant_velocity(t), np.tile(TWIST, (11, 1)))
    states.twist[5] += 0.1
    between = np.array([0.47, 0.533])
    T, twist = states.query(between)
    with_more = States(
        np.insert(t, [5, 6], between),
        np.insert(states.T_world_cam, [5, 6], T, axis=0),
        np.insert(states.twist, [5, 6], twist, axis=0),
    )
    later = np.array([0.44, 0.49, 0.52, 0.58])
    for before, after in zip(states.query(later), with_more.query(later), strict=True):
        assert np.allclose(before, after, atol=1e-9)


def test_a_single_time_is_one_stamped_pose(trajectory: Trajectory) -> None:
    stamped = trajectory.stamped_poses(0.1)
    assert stamped.stamps_ns.tolist() == [trajectory.start_ns + 100_000_000]
    assert np.array_equal(stamped.T_world_cam[0], trajectory.pose(0.1))


def test_save_and_load(trajectory: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "trajectory.npz"
    trajectory.save(path)
    loaded = Trajectory.load(path)
    assert loaded.start_ns == trajectory.start_ns
    for name in ("t", "T_world_cam", "twist", "qc", "knots", "knot_covariance", "velocity_scale"):
        assert np.array_equal(getattr(loaded, name), getattr(trajectory, name))
    assert [file.name for file in tmp_path.iterdir()] == ["trajectory.npz"]


@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04 not an archive", b"1 2 3"])
def test_what_is_no_trajectory_is_one_clear_error(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "trajectory.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"trajectory\.npz") as error:
        Trajectory.load(path)
    assert "\n" not in str(error.value)


def test_an_archive_without_the_fields_is_one_clear_error(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    np.savez(path, t=np.arange(3))
    with pytest.raises(InputError, match="start_ns"):
        Trajectory.load(path)


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("T_world_cam", np.zeros((2, 4, 4))),
        ("twist", np.zeros(6)),
        ("qc", np.array(["a"] * 6)),
        ("start_ns", np.zeros(2)),
        ("t", np.zeros(0)),
        ("t", np.full(11, np.nan)),
        ("knots", np.arange(90, 101)),
        ("knot_covariance", np.zeros((3, 24, 24))),
    ],
)
def test_arrays_that_do_not_fit_are_one_clear_error(
    trajectory: Trajectory, tmp_path: Path, name: str, array: np.ndarray
) -> None:
    path = tmp_path / "trajectory.npz"
    np.savez(path, **(vars(trajectory) | {name: array}))
    with pytest.raises(InputError, match=r"trajectory\.npz: is not a trajectory that"):
        Trajectory.load(path)


def test_a_file_that_is_not_there_is_said_as_such(tmp_path: Path) -> None:
    for read, name in ((Trajectory.load, "path.npz"), (read_tum, "path.tum")):
        with pytest.raises(InputError, match=rf"{name}: no such file$"):
            read(tmp_path / name)


def test_tum_has_the_absolute_stamps_and_nine_decimals(
    trajectory: Trajectory, tmp_path: Path
) -> None:
    stamped = Trajectory(1_504_645_177_123_456_789, *list(vars(trajectory).values())[1:])
    t = np.array([0.1, 0.123456789, 0.2])
    stamped.export_tum(tmp_path / "some.tum", t)
    poses = read_tum(tmp_path / "some.tum")
    assert poses.stamps_ns.tolist() == [stamped.start_ns + round(x * 1e9) for x in t.tolist()]
    assert np.allclose(poses.T_world_cam, stamped.pose(t), atol=2e-9)
    fields = (tmp_path / "some.tum").read_text().split()
    assert all(len(field.partition(".")[2]) == 9 for field in fields)
    stamped.export_tum(tmp_path / "states.tum")
    assert len(read_tum(tmp_path / "states.tum")) == len(trajectory)


def test_a_single_state_has_no_covariance() -> None:
    one = Trajectory(
        0,
        np.zeros(1),
        np.eye(4)[None],
        np.zeros((1, 6)),
        np.ones(6),
        np.empty(0, np.int64),
        np.empty((0, 24, 24)),
        np.empty(0),
    )
    np.testing.assert_array_equal(one.pose(0.0), np.eye(4))
    with pytest.raises(InputError, match="covariance: a trajectory of one state has none"):
        one.covariance(0.0)
