"""The experiment with native and grouped times, on a tiny recording."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import native_times
from benchmarks.known_motion import KnownRecording
from benchmarks.native_times import Tracked, Variant, errors, grouped, run, table, track
from gpvo.simulation import SimulatedRecording


@pytest.fixture(scope="module")
def known(recording: SimulatedRecording) -> KnownRecording:
    return KnownRecording.simulated("tiny", recording)


@pytest.fixture(scope="module")
def tracked(known: KnownRecording) -> Tracked:
    return track(known, "binary")


def test_grouped_events_have_the_time_of_the_clusters_middle(tracked: Tracked) -> None:
    cluster, _ = tracked[1]
    flat = grouped(cluster)
    for before, after in ((cluster.left, flat.left), (cluster.right, flat.right)):
        times = after.surface_of_active_events
        np.testing.assert_array_equal(np.isfinite(times), before.binary_frame > 0)
        assert set(times[np.isfinite(times)]) == {0.5 * (cluster.start + cluster.stop)}


def test_patches_tell_times_and_the_prior_tells_motion(
    known: KnownRecording, tracked: Tracked
) -> None:
    def relative(times: str, rejection: str, estimator: str) -> float:
        variant = Variant(times, rejection, estimator)
        trajectory, inliers = run(known.recording, tracked, variant)
        assert inliers > 10
        evaluation = errors(variant, trajectory, known.ground_truth)
        return float(np.sqrt(np.mean(evaluation.relative_error.norms["se3"] ** 2)))

    best = relative("patch", "MC-RANSAC", "WNOA")
    assert best < relative("nearest", "MC-RANSAC", "WNOA")
    assert best < relative("grouped", "frame-based", "discrete")


def test_table_has_a_row_for_every_variant(
    known: KnownRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    variants = native_times.VARIANTS[-2:]
    monkeypatch.setattr(native_times, "VARIANTS", variants)
    rows = table(known)
    assert rows.row_count == len(variants)
    assert list(rows.columns[0].cells) == [variant.times for variant in variants]
