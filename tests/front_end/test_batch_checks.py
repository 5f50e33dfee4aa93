"""What a recording of a user's own gives is refused before kernels read beyond their arrays."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gpvo.config import ClusteringConfig
from gpvo.errors import InputError
from gpvo.events import Clustering
from gpvo.events.batch_checks import checked_batch
from gpvo.recordings import Camera, Events, StereoEvents, StereoRig

LENS = Camera((16, 12), np.array([20.0, 20, 8, 6]), "none", np.zeros(4), np.eye(3))
RIG = StereoRig(LENS, LENS, 20.0, (8.0, 6.0), 0.1)
GOOD = Events(
    np.arange(4, dtype=np.uint16),
    np.arange(4, dtype=np.uint16),
    np.array([0.1, 0.1, 0.2, 0.3]),
    np.ones(4, bool),
)
BATCH = StereoEvents(0.0, 0.5, GOOD, GOOD)


def test_a_good_batch_is_taken() -> None:
    assert checked_batch(BATCH, RIG) is BATCH
    assert checked_batch(StereoEvents(0.0, 0.0, Events.empty(), Events.empty()), RIG)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": GOOD.x + np.uint16(13)}, r"event 3 is at pixel \(16, 3\), outside the 16 x 12"),
        ({"y": GOOD.y + np.uint16(60000)}, "event 0 is at pixel"),
        ({"t": GOOD.t[::-1]}, "0.2 s at event 1 goes back in time"),
        ({"t": np.array([0.1, np.nan, 0.2, 0.3])}, "nan s at event 1"),
        ({"x": GOOD.x.astype(np.int32)}, "x: must be uint16"),
        ({"t": GOOD.t.astype(">f8")}, "t: must be float64"),
        ({"polarity": GOOD.polarity[:3]}, "polarity: must be bool, one for each event"),
    ],
)
def test_events_that_are_none_are_named(side: str, change: dict[str, Any], message: str) -> None:
    batch = replace(BATCH, **{side: replace(GOOD, **change)})
    with pytest.raises(InputError, match=f"{side}.*{message}"):
        Clustering(RIG, ClusteringConfig()).without_noise(batch)


@pytest.mark.parametrize(("start", "stop"), [(np.nan, 0.5), (0.0, np.inf), (0.5, 0.4)])
def test_a_batch_is_of_an_interval(start: float, stop: float) -> None:
    with pytest.raises(InputError, match=r"batch: from .* give finite seconds"):
        checked_batch(replace(BATCH, start=start, stop=stop), RIG)


def test_batches_come_in_order_of_time() -> None:
    clustering = Clustering(RIG, ClusteringConfig())
    list(clustering.add(BATCH))
    with pytest.raises(InputError, match=r"batch: starts at 0\.0 s, before .* stopped, at 0\.5 s"):
        list(clustering.add(BATCH))
