"""How landmarks look: what turns, reverses or nears changes it, what goes straight on does not."""

from __future__ import annotations

import numpy as np
import pytest

from factors.lie import se3_exp
from gpvo.estimator.landmark_looks import NEARER, Looks

LONG = 100.0
AHEAD = np.array([[0.0, 0.0, 4.0]])
NUMBER = np.array([7])
RIGHT, DOWN = (np.array([0, 0, 0, *v]) for v in ((1.0, 0, 0), (0, 1.0, 0)))
TURN_LEFT = np.array([0, -1.0, 0, 0, 0, 0])


def looks(twist: np.ndarray, point: np.ndarray = AHEAD, T: np.ndarray | None = None) -> Looks:
    return Looks.seen(NUMBER[: len(point)], point, np.eye(4) if T is None else T, twist, LONG)


@pytest.mark.parametrize(
    "after, change",
    [
        (RIGHT, 0.0),
        (5.0 * RIGHT, 0.0),
        (DOWN, np.sqrt(2.0)),
        (-RIGHT, 2.0),
        (TURN_LEFT, 2.0),  # what is passed on the right moves as in a turn to the right
        (RIGHT + np.sqrt(3.0) * DOWN, 1.0),
    ],
)
def test_looks_change_with_the_direction_of_the_image_motion(
    after: np.ndarray, change: float
) -> None:
    assert looks(RIGHT).change_to(looks(after))[0] == pytest.approx(change, abs=1e-12)
    assert looks(after).change_to(looks(RIGHT))[0] == pytest.approx(change, abs=1e-12)


def test_looks_change_as_a_landmark_comes_nearer() -> None:
    near, far = AHEAD / np.e, AHEAD
    assert looks(RIGHT, far).change_to(looks(RIGHT, near))[0] == pytest.approx(NEARER)


def test_the_world_and_a_roll_do_not_matter() -> None:
    """A camera that rolls sees the same contours move the same way over them."""
    T, S = se3_exp([0.2, -0.1, 0.3, 0.5, 0, 0.2]), se3_exp([1.0, 2.0, -0.5, 3.0, 1.0, 2.0])
    world = looks(RIGHT).change_to(looks(DOWN, T=T))
    points = AHEAD @ S[:3, :3].T + S[:3, 3]
    moved = looks(RIGHT, points, S).change_to(looks(DOWN, points, S @ T))
    np.testing.assert_allclose(moved, world, atol=1e-12)
    rolled = se3_exp([0, 0, 0.7, 0, 0, 0])
    same_way = np.concatenate([np.zeros(3), rolled[:3, :3].T @ RIGHT[3:]])
    assert looks(RIGHT).change_to(looks(same_way, T=rolled))[0] == pytest.approx(0.0, abs=1e-12)


def test_pictures_turn_to_a_new_direction_on_their_way() -> None:
    """Little by little, in many short times as in one; at rest nothing changes."""
    before, changes = looks(RIGHT), []
    for duration in (0.0, 1e-3, 1e-2, 1e-1, LONG):
        now = Looks.seen(NUMBER, AHEAD, np.eye(4), -RIGHT, duration)
        changes.append(before.change_to(before.turned_to(now))[0])
    assert changes[0] == pytest.approx(0.0, abs=1e-12) and (np.diff(changes) > 0).all()
    assert changes[-1] == pytest.approx(2.0)
    parts = before
    for _ in range(10):
        parts = parts.turned_to(Looks.seen(NUMBER, AHEAD, np.eye(4), -RIGHT, 1e-3))
    whole = before.turned_to(Looks.seen(NUMBER, AHEAD, np.eye(4), -RIGHT, 1e-2))
    np.testing.assert_allclose(parts.direction, whole.direction, atol=1e-12)
    rest = Looks.seen(NUMBER, AHEAD, np.eye(4), np.zeros(6), 1.0)
    assert before.change_to(before.turned_to(rest))[0] == pytest.approx(0.0, abs=1e-9)


def test_new_landmarks_look_as_they_go_on() -> None:
    """They have not changed, and the others keep their own looks."""
    numbers, points = np.array([3, 7, 9]), np.repeat(AHEAD, 3, axis=0)
    now = Looks.seen(numbers, points, np.eye(4), DOWN, 1e-3)
    turned = looks(RIGHT).turned_to(now)
    assert turned.number.tolist() == [3, 7, 9]
    np.testing.assert_allclose(np.linalg.norm(turned.direction[[0, 2]], axis=1), 1.0)
    assert looks(RIGHT).change_to(turned)[[0, 2]].tolist() == [0.0, 0.0]
    both = looks(RIGHT).updated(Looks.seen(numbers[::2], points[::2], np.eye(4), DOWN))
    assert both.number.tolist() == [3, 7, 9]
    np.testing.assert_array_equal(both.direction[1:2], looks(RIGHT).direction)
