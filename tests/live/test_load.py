"""Load is shed while the computer is busy, late or behind, and taken up again after."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpvo.events.clustering import WIDEST
from gpvo.live.load import BUSY, CAUGHT_UP, EARLY, FEWEST, LATE, LEAST, OLD, Level, Load

USUAL = 0.05
"""Usual length of clusters, seconds."""


def work(load: Load, seconds: float, latency: float = 0.0, clusters: int = 100) -> list[Level]:
    """Return the level after each cluster, whose work always takes some seconds."""
    levels = []
    for _ in range(clusters):
        load.worked(seconds, USUAL * load.level.spacing, latency)
        levels.append(load.level)
    return levels


@given(st.floats(0.0, 4.0))
def test_clusters_are_so_far_apart_that_their_work_leaves_time(share: float) -> None:
    """Without time between them it would take a share of the time."""
    spacing = work(Load(), share * USUAL)[-1].spacing
    assert spacing == pytest.approx(np.clip(share / BUSY, 1.0, WIDEST), rel=1e-3)


def test_no_time_is_left_out_when_there_is_time_again() -> None:
    load = Load()
    apart = work(load, 1.2 * USUAL)
    spacing = np.array([level.spacing for level in apart + work(load, 0.5 * USUAL)])
    assert (np.diff(spacing[:100]) >= 0).all() and (np.diff(spacing[100:]) <= 0).all()
    assert spacing[-1] == 1.0 and load.level == Level()


def test_one_cluster_that_takes_long_changes_little() -> None:
    load = Load()
    work(load, 0.5 * BUSY * USUAL)
    load.worked(100 * USUAL, USUAL, 0.0)
    assert load.level.spacing <= WIDEST
    assert work(load, 0.5 * BUSY * USUAL, clusters=5)[-1] == Level()


def test_late_estimates_cost_features_alone() -> None:
    load = Load()
    levels = work(load, 0.0, latency=2 * LATE)
    shares = np.array([level.features for level in levels])
    assert (np.diff(shares) <= 0).all() and shares[-1] == FEWEST
    assert all(level == Level(features=level.features) for level in levels)
    assert work(load, 0.0, latency=(EARLY + LATE) / 2)[-1].features == FEWEST
    again = np.array([level.features for level in work(load, 0.0, latency=0.5 * EARLY)])
    assert (np.diff(again) >= 0).all() and again[-1] == 1.0
    assert np.flatnonzero(again == 1.0)[0] > np.flatnonzero(shares == FEWEST)[0]


def test_while_events_wait_as_much_is_shed_as_the_motion_can_be_followed_with() -> None:
    load = Load()
    ages = [0.0, 0.9 * OLD, 1.1 * OLD, 0.9 * OLD, 1.1 * CAUGHT_UP, 0.9 * CAUGHT_UP, 0.9 * OLD]
    levels = []
    for index, age in enumerate(ages):
        load.waited(age, 10.0 + index)
        levels.append(load.level)
    assert levels == [Level(), Level(), LEAST, LEAST, LEAST, Level(), Level()]
    assert load.worst == LEAST and load.seconds == 6 and load.full_seconds == 3


def test_the_time_of_a_cluster_alone_sheds_nothing() -> None:
    load = Load()
    ages = [0.0, 0.05, 0.1, 0.02, 0.001] * 40
    for index, age in enumerate(ages):
        load.waited(age, index / 100)
        assert load.level == Level()


def test_the_first_time_is_no_time() -> None:
    load = Load()
    load.waited(0.9 * OLD, 1e6)
    assert load.level == load.worst == Level() and load.seconds == 0


def test_what_is_shed_is_said() -> None:
    assert str(Level()) == "nothing is shed"
    assert str(Level(1.25, 0.7)) == "80% of the events, 70% of the features"
    assert str(LEAST) == "25% of the events, 50% of the features"
    assert Level(2.0, 1.0).and_less(Level(1.0, 0.6)) == Level(2.0, 0.6)
