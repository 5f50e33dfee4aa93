"""Load is shed in a fixed order while the computer is behind, and taken up again after."""

from __future__ import annotations

import numpy as np
import pytest

from gpvo.live.load import CAUGHT_UP, HURRY, LATE, LEVELS, MOST_PATIENCE, OLD, PATIENCE, Load
from gpvo.recordings.streams import EventBlock


def after(
    load: Load, ages: list[float], begin: float, step: float = 0.01, latency: float = 0.0
) -> list[int]:
    """Return the level after each of the ages, `step` seconds apart."""
    levels = []
    for index, age in enumerate(ages):
        load.update(age, latency, begin + step * index)
        levels.append(LEVELS.index(load.level))
    return levels


def test_less_and_less_is_used_while_behind_and_all_of_it_in_the_end() -> None:
    load = Load()
    assert after(load, [0.0] * 100, 10.0) == [0] * 100
    behind = after(load, [2 * CAUGHT_UP] * 200, 11.0)
    assert behind[-1] == len(LEVELS) - 1
    assert np.isin(np.diff(behind), (0, 1)).all()
    assert behind[int(HURRY / 0.01) - 2] == 0
    caught_up = after(load, [0.0] * 800, 13.0)
    assert np.isin(np.diff(caught_up), (0, -1)).all()
    assert load.is_full and caught_up.index(0) > 100 * PATIENCE * (len(LEVELS) - 2)


def test_what_waits_long_hurries() -> None:
    slowly, quickly = (after(Load(), [age] * 100, 10.0) for age in (0.9 * OLD, 1.1 * OLD))
    assert max(slowly) < max(quickly)


def test_late_estimates_cost_features_alone() -> None:
    load = Load()
    after(load, [0.0] * 10, 10.0)
    levels = set(after(load, [0.0] * 500, 10.1, latency=2 * LATE))
    assert levels == {0, 1, 2} and all(LEVELS[level].cluster_length == 1 for level in levels)


def test_late_estimates_do_not_keep_clusters_long() -> None:
    load = Load()
    after(load, [2 * CAUGHT_UP] * 300, 10.0, latency=2 * LATE)
    assert load.level == LEVELS[-1]
    after(load, [0.0] * 3000, 13.0, latency=2 * LATE)
    assert load.level == LEVELS[2] and load.level.cluster_length == 1


def test_what_waits_at_first_sheds_nothing() -> None:
    load = Load()
    load.update(2 * CAUGHT_UP, 0.0, 1e6)
    assert load.is_full and sum(load.seconds) == 0


def test_what_is_tried_in_vain_is_tried_half_as_often() -> None:
    """All features make the estimates late, half of them do not."""
    load, tried = Load(), []
    for index in range(6000):
        was_full, now = load.is_full, 10.0 + 0.01 * index
        load.update(0.0, 2 * LATE if was_full else 0.0, now)
        if load.is_full and not was_full:
            tried.append(now)
    apart = np.diff(tried)
    assert len(apart) >= 3 and apart.max() < MOST_PATIENCE + 2 * HURRY
    assert (apart[1:] > np.minimum(1.5 * apart[:-1], MOST_PATIENCE)).all()


def test_the_time_of_a_cluster_alone_sheds_nothing() -> None:
    load = Load()
    assert not any(after(load, [0.0, 0.05, 0.1, 0.02, 0.001] * 40, 10.0, 0.02))


def test_what_is_shed_is_counted() -> None:
    load = Load()
    after(load, [1.0] * 200, 10.0)
    block = EventBlock(*(np.arange(10).astype(kind) for kind in ("u2", "u2", "i8", "?")))
    assert len(load.thin(block)) == 3 and load.thinned == 7


def test_features_then_clusters_then_events_are_shed() -> None:
    features, lengths, strides = (
        [getattr(one, name) for one in LEVELS] for name in ("features", "cluster_length", "stride")
    )
    assert features == sorted(features, reverse=True)
    assert lengths == sorted(lengths) and strides == sorted(strides)
    first_longer, first_thinned = (
        next(index for index, value in enumerate(values) if value > 1)
        for values in (lengths, strides)
    )
    assert features[first_longer] < 1 and lengths[first_thinned - 1] == max(lengths)


def test_what_is_shed_is_said_and_for_how_long() -> None:
    load = Load()
    after(load, [0.0] * 101, 10.0)
    after(load, [2 * CAUGHT_UP] * 200, 11.01)
    assert load.seconds[0] == pytest.approx(1.0 + HURRY, abs=0.05)
    assert sum(load.seconds) == pytest.approx(3.0)
    assert str(LEVELS[0]) == "nothing is shed"
    assert str(LEVELS[-1]) == "25% of the features, clusters 2 times longer, one of 4 events"
