"""The ratio of two cameras' contrast thresholds is told by how many events their pixels have."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpvo import Odometry
from gpvo.evaluation.front_end.truth import truth_of_simulation
from gpvo.events import ClusterEvents, StereoCluster
from gpvo.mapping.recorder import MeasurementRecorder
from gpvo.recordings import Events
from gpvo.simulation import SimulationConfig, simulate
from gpvo.tracking import event_spacing
from gpvo.tracking.event_spacing import ENOUGH
from gpvo.tracking.threshold_ratio import (
    DOUBT,
    FEWEST,
    MOST,
    ThresholdRatio,
    threshold_over_contrast,
)

SIDE = 200
seeds = st.integers(0, 2**32)


def cluster(counts: np.ndarray, noise: float = 0.0) -> ClusterEvents:
    """The events of an image (SIDE, SIDE) of their numbers, in any order, in two parts."""
    y, x = np.divmod(np.repeat(np.arange(SIDE * SIDE), counts.ravel()), SIDE)
    order = np.random.default_rng(0).permutation(len(x))
    x, y = (column[order].astype(np.uint16) for column in (x, y))
    events = Events(x, y, np.zeros(len(x)), np.ones(len(x), bool))
    table = np.dstack(np.meshgrid(np.arange(SIDE), np.arange(SIDE))).astype(np.float32)
    half = len(x) // 2
    return ClusterEvents((events[:half], events[half:]), table, (SIDE, SIDE), noise_count=noise)


def contrasts(seed: int) -> np.ndarray:
    """Exponential ones, of mean one."""
    return np.random.default_rng(seed).exponential(1.0, (SIDE, SIDE))


def deviation(counts: np.ndarray, threshold: float) -> float:
    """Relative standard deviation of the threshold by a mean of geometric numbers."""
    pixels = np.count_nonzero(counts) / max(1, counts.sum() // ENOUGH)
    any_event = 1 - np.exp(-threshold)
    return float(any_event / (threshold * np.sqrt((1 - any_event) * pixels)))


def stereo(left: ClusterEvents, right: ClusterEvents) -> StereoCluster:
    return StereoCluster(0.0, 0.1, left, right)


@settings(max_examples=20, deadline=None)
@given(seeds, st.floats(0.2, 2.0))
def test_it_tells_the_threshold_of_exponential_contrasts(seed: int, threshold: float) -> None:
    counts = (contrasts(seed) / threshold).astype(int)
    error = np.log(threshold_over_contrast(cluster(counts)) / threshold)
    assert abs(error) < 6 * deviation(counts, threshold)


@settings(max_examples=10, deadline=None)
@given(seeds, st.floats(1 / 1.5, 1.5))
def test_dead_pixels_and_another_view_do_not_matter(seed: int, ratio: float) -> None:
    """The right camera sees other contours, and half of its pixels are dead."""
    thresholds, found = (0.5, 0.5 * ratio), ThresholdRatio()
    left, right = ((contrasts(seed + k) / thresholds[k]).astype(int) for k in (0, 1))
    right[np.random.default_rng(seed).random(right.shape) < 0.5] = 0
    found.follow(stereo(cluster(left), cluster(right)))
    scatter = np.hypot(deviation(left, thresholds[0]), deviation(right, thresholds[1]))
    # What is taken off the logarithm of the ratio is DOUBT / sqrt(e) at most, its slope 1.5.
    assert abs(np.log(found.value / ratio)) < 0.61 * DOUBT + 6 * 1.5 * scatter


def test_noise_is_not_counted() -> None:
    counts = (contrasts(1) / 0.8).astype(int)
    noise = (np.random.default_rng(2).random(counts.shape) < 0.1) & (counts == 0)
    alone = threshold_over_contrast(cluster(counts))
    among = threshold_over_contrast(cluster(counts + noise, float(noise.sum())))
    assert among == pytest.approx(alone, rel=1e-9)


def test_a_part_of_many_events_tells_it(monkeypatch: pytest.MonkeyPatch) -> None:
    many = cluster((contrasts(3) / 0.3).astype(int))
    whole = threshold_over_contrast(many)
    monkeypatch.setattr(event_spacing, "ENOUGH", many.event_count // 4)
    assert threshold_over_contrast(many) == pytest.approx(whole, rel=0.05)
    assert threshold_over_contrast(many) != whole


def test_the_ratio_is_a_mean_over_clusters_within_bounds() -> None:
    """Its logarithm is, and clusters that tell nothing are left out."""
    ratio, of = ThresholdRatio(), partial(np.full, (SIDE, SIDE), dtype=int)
    few = of(0)
    few.ravel()[: FEWEST - 1] = 2
    for nothing in (of(0), of(1), few):
        ratio.follow(stereo(cluster(of(2)), cluster(nothing)))
    assert ratio.value == 1
    two, three = (threshold_over_contrast(cluster(of(n))) for n in (2, 3))
    ratio.follow(stereo(cluster(of(3)), cluster(of(2))))
    assert ratio.value == pytest.approx(two / three)
    ratio.follow(stereo(cluster(of(2)), cluster(of(2))))
    assert ratio.value == pytest.approx((two / three) ** 0.5)
    other = ThresholdRatio()
    other.follow(stereo(cluster(of(20)), cluster(of(2))))
    assert other.value == pytest.approx(MOST)


def test_it_is_not_told_where_one_camera_is_noisy() -> None:
    """The noise filter, too, leaves out events of contours there."""
    counts = (contrasts(4) / 0.5).astype(int)
    clean, other, ratio = cluster(counts), cluster(counts // 2), ThresholdRatio()
    few = replace(other, noise_count=0.1 * other.event_count)
    noisy = replace(few, left_out=(other.event_count // 10, 0))
    ratio.follow(stereo(clean, noisy))
    assert ratio.value == 1
    ratio.follow(stereo(clean, few))
    assert ratio.value > 1.1


def test_it_begins_again_when_the_noise_becomes_known() -> None:
    """Before that noise is counted as events of contours."""
    counts = (contrasts(5) / 0.5).astype(int)
    left, right = cluster(counts), cluster(counts // 2)
    ratio = ThresholdRatio()
    for _ in range(3):
        ratio.follow(stereo(left, right))
    wrong = ratio.value
    known = replace(left, noise_count=1.0)
    ratio.follow(stereo(known, left))
    assert wrong > 1.1 and ratio.value == pytest.approx(1, abs=1e-3)


def test_disparities_have_no_bias_where_the_cameras_differ() -> None:
    """The camera moves to one side, where contours lag along their rows."""
    config = SimulationConfig(
        seed=10,
        motion="back_and_forth",
        duration=0.5,
        resolution=(240, 180),
        focal_length=157.0,
        threshold=0.2,
        right_threshold=0.3,
    )
    recording, seen = simulate(config), MeasurementRecorder()
    odometry = Odometry(recording.rig, observer=seen)
    odometry.run(recording)
    disparity = truth_of_simulation(recording).disparity(seen.measurements, odometry.camera)
    error = seen.measurements.stereo[:, 2] - disparity
    assert abs(np.median(error)) < 0.04
