"""Stamped poses: construction, interpolation and the TUM format."""

from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from factors.lie import se3_inverse
from gpvo.commands.live_trajectory import UNFINISHED, live_file
from gpvo.errors import InputError
from gpvo.trajectory import StampedPoses, States, read_tum, write_tum
from gpvo.trajectory.stamped_poses import quaternions, rigid_transforms, seconds_text
from gpvo.trajectory.tum import parse_tum, tum_lines

GOOD = "1.5 1 2 3 0 0 0 1"


def test_interpolation_gives_the_poses_back_at_their_own_stamps(random_walk):
    poses = random_walk()
    again = poses.interpolate(poses.stamps_ns)
    np.testing.assert_allclose(again.T_world_cam, poses.T_world_cam, atol=1e-14)


def test_interpolation_is_slerp_and_linear_in_position(random_walk):
    poses = random_walk(1)
    query = np.linspace(poses.stamps_ns[0], poses.stamps_ns[-1], 777).astype(np.int64)
    between = poses.interpolate(query)
    seconds = (query - poses.stamps_ns[0]) * 1e-9
    slerp = Slerp(poses.seconds, Rotation.from_matrix(poses.rotations))
    np.testing.assert_allclose(between.rotations, slerp(seconds).as_matrix(), atol=1e-9)
    for axis in range(3):
        expected = np.interp(seconds, poses.seconds, poses.positions[:, axis])
        np.testing.assert_allclose(between.positions[:, axis], expected, atol=1e-9)


def test_interpolation_does_not_extrapolate(random_walk):
    poses = random_walk()
    for stamp in (poses.stamps_ns[0] - 1, poses.stamps_ns[-1] + 1):
        with pytest.raises(InputError, match="poses cover"):
            poses.interpolate([stamp])
    with pytest.raises(InputError, match="at least two"):
        poses[:1].interpolate(poses.stamps_ns[:1])


@pytest.mark.parametrize(
    ("entry", "value"), [((2, 2), -1.0), ((0, 1), 0.1), ((3, 0), 0.5), ((3, 3), 2.0), ((3, 3), 0.0)]
)
def test_a_pose_that_is_no_rigid_transform_is_named(entry, value):
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[(1, *entry)] = value
    with pytest.raises(InputError, match="pose 1 is no rigid transform"):
        StampedPoses(np.arange(3), poses)


def test_change_of_world_and_body_commute(random_walk, random_transform):
    poses, A, B = random_walk(2), random_transform(1), random_transform(2)
    one = poses.in_world(A).seen_from(B).T_world_cam
    other = poses.seen_from(B).in_world(A).T_world_cam
    np.testing.assert_allclose(one, other, atol=1e-12)


def test_inverse(random_walk):
    T = random_walk(3).T_world_cam
    identity = np.broadcast_to(np.eye(4), T.shape)
    np.testing.assert_allclose(se3_inverse(T) @ T, identity, atol=1e-12)


def test_between_keeps_both_ends(random_walk):
    poses = random_walk()
    part = poses.between(poses.stamps_ns[3], poses.stamps_ns[7])
    np.testing.assert_array_equal(part.stamps_ns, poses.stamps_ns[3:8])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s, T: (s[::-1], T), "must increase"),
        (lambda s, T: (s[:-1], T), "do not fit"),
        (lambda s, T: (s, T * np.nan), "finite"),
        (lambda s, T: (s, T * 1.01), "skewed"),
    ],
)
def test_poses_that_cannot_be_are_rejected(random_walk, change, message):
    poses = random_walk()
    with pytest.raises(InputError, match=message):
        StampedPoses(*change(poses.stamps_ns, poses.T_world_cam))


@given(st.integers(-(2**63) + 1, 2**63 - 1))
@settings(deadline=None)
def test_every_nanosecond_survives_the_tum_format(stamp_ns):
    line = f"{seconds_text(stamp_ns)} 0 0 0 0 0 0 1"
    assert parse_tum([line], "file").stamps_ns[0] == stamp_ns


@given(
    rotation=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    position=st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3),
)
@settings(deadline=None)
def test_every_pose_survives_the_tum_format(rotation, position):
    T = rigid_transforms(Rotation.from_rotvec([rotation]).as_matrix(), np.array([position]))
    again = parse_tum(tum_lines(StampedPoses(np.array([7]), T)), "file")
    np.testing.assert_allclose(again.T_world_cam, T, atol=4e-9)


def test_appended_lines_equal_the_written_file(random_walk, tmp_path):
    poses = random_walk()
    write_tum(tmp_path / "whole.tum", poses)
    states = States(poses.seconds, poses.T_world_cam, np.zeros((len(poses), 6)))
    start_ns, path = int(poses.stamps_ns[0]), tmp_path / "appended.tum"
    step = Mock()
    step.estimator.final_states = lambda last: states.after(last)[:3]
    with live_file(path, lambda: start_ns) as append_final:
        for _ in range(0, len(poses) + 3, 3):
            append_final(step)
            on_disk = path.read_bytes()
            assert on_disk.endswith(b"\n")
    heading = f"# {UNFINISHED}\n".encode()
    assert on_disk == heading + (tmp_path / "whole.tum").read_bytes()


def test_quaternions_do_not_depend_on_the_sign_of_their_source(random_walk):
    rotations = random_walk(4).rotations
    q = quaternions(rotations)
    assert (q[:, 3] >= 0.0).all()
    np.testing.assert_allclose(Rotation.from_quat(-q).as_matrix(), rotations, atol=1e-12)


def test_quaternions_are_normalised_and_comments_skipped(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text(
        "# t x y z\n\n1.5, 1, 2, 3, 0, 0, 0, 1.004\n1.6 0 0 0 0 0 0.7071 0.7071 # end\n"
    )
    poses = read_tum(path)
    np.testing.assert_allclose(
        poses.T_world_cam[0], [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    )
    np.testing.assert_allclose(poses.rotations[1] @ [1, 0, 0], [0, 1, 0], atol=1e-15)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1.5 0 0 0 0 0 0 1", "does not come after"),
        ("1.4 0 0 0 0 0 0 1", "does not come after"),
        ("2 0 0 0 0 0 1", "has 7 numbers"),
        ("2 0 0 0 0 0 0 1 9", "has 9 numbers"),
        ("2 0 0 x 0 0 0 1", "not eight numbers"),
        ("nan 0 0 0 0 0 0 1", "not eight numbers"),
        ("1e999999999 0 0 0 0 0 0 1", "not eight numbers"),
        ("1504645187579542725 0 0 0 0 0 0 1", "not eight numbers"),
        ("2 nan 0 0 0 0 0 1", "not finite"),
        ("2 0 0 0 0 0 0 0", "norm 0"),
        ("2 0 0 0 0 0 0 1.2", "norm 1.2"),
    ],
)
def test_bad_lines_are_named(tmp_path, line, message):
    path = tmp_path / "poses.txt"
    path.write_text(f"# comment\n{GOOD}\n{line}\n")
    with pytest.raises(InputError, match=f"poses.txt:3: .*{message}"):
        read_tum(path)


def test_files_that_hold_no_poses(tmp_path):
    (tmp_path / "empty.txt").write_text("# nothing\n")
    (tmp_path / "binary.txt").write_bytes(b"\xff\xfe\x80\x81")
    with pytest.raises(InputError, match="holds no pose"):
        read_tum(tmp_path / "empty.txt")
    for name in ("binary.txt", "missing.txt"):
        with pytest.raises(InputError, match=name):
            read_tum(tmp_path / name)
