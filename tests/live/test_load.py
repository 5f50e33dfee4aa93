"""Load is shed in a fixed order while the computer is busy or behind, and taken up again after."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpvo.live.load import (
    BEHIND,
    BUSY,
    CAUGHT_UP,
    EARLY,
    FEWEST,
    HURRY,
    LATE,
    LONGEST_CLUSTERS,
    MOST_PATIENCE,
    OLD,
    PATIENCE,
    Level,
    Load,
)
from gpvo.recordings.streams import EventBlock

USUAL = 0.05
"""Usual length of clusters, seconds."""


def behind(load: Load, ages: list[float], begin: float, step: float = 0.01) -> list[int]:
    """Return how far behind the load is after each of the ages, `step` seconds apart."""
    steps = []
    for index, age in enumerate(ages):
        load.waited(age, begin + step * index)
        steps.append(max(k for k, least in enumerate(BEHIND) if sheds(load.level, least)))
    return steps


def sheds(level: Level, least: Level) -> bool:
    """Whether a level sheds at least what another one does."""
    return level.and_less(least) == level


def work(load: Load, seconds: float, latency: float = 0.0, clusters: int = 100) -> list[Level]:
    """Return the level after each cluster, whose work always takes some seconds."""
    levels = []
    for _ in range(clusters):
        load.worked(seconds, USUAL * load.level.cluster_length, latency)
        levels.append(load.level)
    return levels


@given(st.floats(0.0, 4.0))
def test_clusters_are_so_long_that_their_work_leaves_time(share: float) -> None:
    """Those of the usual length would take a share of the time."""
    length = work(Load(), share * USUAL)[-1].cluster_length
    assert length == pytest.approx(np.clip(share / BUSY, 1.0, LONGEST_CLUSTERS), rel=1e-3)


def test_clusters_are_short_again_when_there_is_time() -> None:
    load = Load()
    longer = work(load, 1.2 * USUAL)
    lengths = np.array([level.cluster_length for level in longer + work(load, 0.5 * USUAL)])
    assert (np.diff(lengths[:100]) >= 0).all() and (np.diff(lengths[100:]) <= 0).all()
    assert lengths[-1] == 1.0 and load.level == Level()


def test_one_cluster_that_takes_long_changes_little() -> None:
    load = Load()
    work(load, 0.5 * BUSY * USUAL)
    load.worked(100 * USUAL, USUAL, 0.0)
    assert load.level.cluster_length <= LONGEST_CLUSTERS
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


def test_less_and_less_is_used_while_behind_and_all_of_it_in_the_end() -> None:
    load, last = Load(), len(BEHIND) - 1
    assert behind(load, [0.0] * 100, 10.0) == [0] * 100
    more = behind(load, [2 * CAUGHT_UP] * 200, 11.0)
    assert more[-1] == last and np.isin(np.diff(more), (0, 1)).all()
    assert more[int(HURRY / 0.01) - 2] == 0
    less = behind(load, [0.0] * 800, 13.0)
    assert np.isin(np.diff(less), (0, -1)).all()
    assert load.level == Level() and less.index(0) > 100 * PATIENCE * (last - 1)


def test_what_waits_long_hurries() -> None:
    slowly, quickly = (behind(Load(), [age] * 100, 10.0) for age in (0.9 * OLD, 1.1 * OLD))
    assert sum(slowly) < sum(quickly)


def test_what_waits_at_first_sheds_nothing() -> None:
    load = Load()
    load.waited(2 * CAUGHT_UP, 1e6)
    assert load.level == load.worst == Level() and load.seconds == 0


def test_what_is_tried_in_vain_is_tried_half_as_often() -> None:
    """Events wait whenever all of them are used."""
    load, tried = Load(), []
    for index in range(6000):
        was_behind, now = load.is_behind, 10.0 + 0.01 * index
        load.waited(0.0 if was_behind else 2 * CAUGHT_UP, now)
        if was_behind and not load.is_behind:
            tried.append(now)
    apart = np.diff(tried)
    assert len(apart) >= 3 and apart.max() < MOST_PATIENCE + 2 * HURRY
    assert (apart[1:] > np.minimum(1.5 * apart[:-1], MOST_PATIENCE)).all()


def test_the_time_of_a_cluster_alone_sheds_nothing() -> None:
    load = Load()
    assert not any(behind(load, [0.0, 0.05, 0.1, 0.02, 0.001] * 40, 10.0))
    assert load.worst == Level()


def test_what_is_shed_is_counted() -> None:
    load = Load()
    behind(load, [1.0] * 200, 10.0)
    block = EventBlock(*(np.arange(10).astype(kind) for kind in ("u2", "u2", "i8", "?")))
    assert len(load.thin(block)) == 3 and load.thinned == 7


def test_while_behind_features_are_given_up_before_events() -> None:
    for less, more in pairwise(BEHIND):
        assert sheds(more, less)
        assert more.stride == 1 or less.features < 1
    assert BEHIND[0] == Level() and BEHIND[1].stride == 1


def test_what_is_shed_is_said_and_for_how_long() -> None:
    load = Load()
    behind(load, [0.0] * 101, 10.0)
    behind(load, [2 * CAUGHT_UP] * 200, 11.01)
    assert load.full_seconds == pytest.approx(1.0 + HURRY, abs=0.05)
    assert load.seconds == pytest.approx(3.0)
    assert load.worst == BEHIND[-1]
    assert str(Level()) == "nothing is shed"
    assert str(Level(1.25, 0.7)) == "clusters 1.2 times longer, 70% of the features"
    assert str(BEHIND[-1]) == "25% of the features, one of 4 events"
