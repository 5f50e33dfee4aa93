"""Load is shed in a fixed order while the computer is behind, and taken up again after."""

from __future__ import annotations

import numpy as np

from gpvo.live.load import CAUGHT_UP, HURRY, LEVELS, PATIENCE, Load
from gpvo.recordings.streams import EventBlock


def after(load: Load, ages: list[float], begin: float, step: float = 0.01) -> list[int]:
    """Return the level after each of the ages, `step` seconds apart."""
    levels = []
    for index, age in enumerate(ages):
        load.update(age, begin + step * index)
        levels.append(LEVELS.index(load.level))
    return levels


def test_less_and_less_is_used_while_behind_and_all_of_it_in_the_end() -> None:
    load = Load()
    assert after(load, [0.0] * 100, 10.0) == [0] * 100
    behind = after(load, [2 * CAUGHT_UP] * 200, 11.0)
    assert behind[-1] == len(LEVELS) - 1
    assert np.isin(np.diff(behind), (0, 1)).all()
    assert behind[int(HURRY / 0.01) - 2] == 0
    caught_up = after(load, [0.0] * 400, 13.0)
    assert np.isin(np.diff(caught_up), (0, -1)).all()
    assert load.is_full and caught_up.index(0) > 100 * PATIENCE * (len(LEVELS) - 2)


def test_the_time_of_a_cluster_alone_sheds_nothing() -> None:
    load = Load()
    assert not any(after(load, [0.0, 0.05, 0.1, 0.02, 0.001] * 40, 10.0, 0.02))


def test_what_is_shed_is_counted() -> None:
    load = Load()
    after(load, [1.0] * 200, 10.0)
    block = EventBlock(*(np.arange(10).astype(kind) for kind in ("u2", "u2", "i8", "?")))
    assert len(load.thin(block)) == 3 and load.thinned == 7


def test_features_are_shed_before_events() -> None:
    features, events = ([getattr(one, name) for one in LEVELS] for name in ("features", "stride"))
    assert features == sorted(features, reverse=True) and events == sorted(events)
    first_thinned = next(index for index, stride in enumerate(events) if stride > 1)
    assert features[first_thinned - 1] == min(features)
