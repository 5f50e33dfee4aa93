"""`preset: paper` has the paper's values; what is given wins over it, and it survives the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from gpvo.config import (
    ClusteringConfig,
    Configuration,
    NoiseConfig,
    configuration_text,
    for_camera,
    load_configuration,
)
from gpvo.errors import InputError

PAPER = Configuration.model_validate({"preset": "paper"})


def test_values_of_section_iv_a_of_the_paper() -> None:
    assert PAPER.preset == "paper"
    assert (PAPER.estimator.method, PAPER.estimator.window) == ("batch", 5)
    assert PAPER.estimator.relative_decrease == 0.01
    assert (PAPER.estimator.state_interval, PAPER.estimator.loss, PAPER.estimator.gate) == (
        0.0,
        "none",
        0.0,
    )
    assert (PAPER.tracking.tracker, PAPER.tracking.image) == ("viso2", "binary")
    assert PAPER.tracking.resolutions == (1, 2)
    assert PAPER.tracklets.time_radius == 0.0
    assert PAPER.tracklets.max_stereo_time_difference == 0.020
    assert (PAPER.tracklets.min_disparity, PAPER.tracklets.min_length) == (2.0, 2.0)
    assert PAPER.tracklets.min_duration == 0.040
    assert (PAPER.mc_ransac.iterations, PAPER.mc_ransac.refinements) == (10_000, 1)
    assert (PAPER.mc_ransac.relative_threshold, PAPER.mc_ransac.pixel_threshold) == (0.05, 0.0)
    assert PAPER.mc_ransac.confidence == 1.0
    inverse_psd = 1 / np.array(PAPER.noise.acceleration_psd)
    np.testing.assert_allclose(inverse_psd, 50 * np.array([10, 10, 10, 1, 1, 1]))
    np.testing.assert_allclose(PAPER.noise.measurement_information, 0.1 * np.array([5, 5, 1]))
    assert PAPER.noise.track_drift == 0.0


def test_the_paper_has_none_of_the_ways_that_departed_from_it() -> None:
    """Whichever tracker and image are set by hand beside it."""
    klt, compensation = PAPER.tracking.klt, PAPER.tracking.compensation
    assert (klt.crowding, klt.candidates, klt.anchor_correlation) == (None, 1.0, 1.0)
    assert (klt.slopes, klt.deviations, klt.lost_landmarks) == (False, False, 0)
    assert (compensation.lag_share, compensation.little_motion) == (0.0, 0.0)
    assert compensation.density is None


def test_the_paper_looks_at_all_events() -> None:
    clustering = PAPER.clustering
    assert (clustering.background_filter, clustering.hot_pixel_ratio) == (0.0, 0.0)
    assert not clustering.skip_flashes and clustering.max_events is not None


def test_auto_is_the_default() -> None:
    assert Configuration.model_validate({"preset": "auto"}) == Configuration()


def test_what_is_given_wins_at_every_level() -> None:
    given = {
        "preset": "paper",
        "clustering": {"max_events": None},
        "tracking": {"klt": {"patch_size": 21}, "tracker": "klt"},
        "noise": NoiseConfig(track_drift=0.1),
        "seed": 3,
    }
    found = Configuration.model_validate(given)
    assert found.clustering == PAPER.clustering.model_copy(update={"max_events": None})
    assert (found.tracking.tracker, found.tracking.klt.patch_size) == ("klt", 21)
    assert found.tracking.resolutions == (1, 2)
    assert found.noise == PAPER.noise.model_copy(update={"track_drift": 0.1})
    assert (found.seed, found.mc_ransac) == (3, PAPER.mc_ransac)
    assert given["tracking"] == {"klt": {"patch_size": 21}, "tracker": "klt"}  # not changed


def test_a_whole_stage_that_is_given_wins() -> None:
    whole = ClusteringConfig.model_validate(ClusteringConfig().model_dump())
    assert Configuration(preset="paper", clustering=whole).clustering == ClusteringConfig()


@pytest.mark.parametrize("size", [(346, 260), (1280, 720)])
@pytest.mark.parametrize("preset", ["auto", "paper"])
@pytest.mark.parametrize("described", [False, True])
def test_what_a_run_writes_is_the_same_configuration_again(
    preset: str, size: tuple[int, int], described: bool, tmp_path: Path
) -> None:
    values = {"preset": preset, "estimator": {"window": 7}, "noise": {"track_drift": 0.3}}
    configuration = for_camera(Configuration.model_validate(values), size, 226.0)
    file = tmp_path / "config.yaml"
    file.write_text(configuration_text(configuration, described))
    assert load_configuration(file) == configuration


@pytest.mark.parametrize("preset", ["esvo", "[paper]", "{paper: 1}", "3"])
def test_unknown_preset_is_one_clear_error(preset: str, tmp_path: Path) -> None:
    file = tmp_path / "config.yaml"
    file.write_text(f"preset: {preset}\n")
    with pytest.raises(InputError) as error:
        load_configuration(file)
    message = str(error.value)
    assert message.startswith(f"{file}: preset: ") and "'auto' or 'paper'" in message
    assert "gpvo config" in message


@pytest.mark.parametrize("number", ["0", "-1", "1e-30", "1e12", ".nan", ".inf"])
@pytest.mark.parametrize(
    ("field", "size"), [("acceleration_psd", 6), ("measurement_information", 3)]
)
def test_noise_outside_its_meaning_is_one_clear_error(
    field: str, size: int, number: str, tmp_path: Path
) -> None:
    file = tmp_path / "config.yaml"
    file.write_text(f"noise: {{{field}: [{', '.join(['1.0'] * (size - 1) + [number])}]}}\n")
    with pytest.raises(InputError, match=rf"noise\.{field}\.{size - 1}: Input should be"):
        load_configuration(file)


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_a_field_that_is_not_finite_is_an_error(number: float) -> None:
    with pytest.raises(ValidationError, match="finite"):
        NoiseConfig(initial_velocity=number)


def test_misspelt_field_beside_a_preset_is_named() -> None:
    with pytest.raises(ValidationError) as error:
        Configuration.model_validate({"preset": "paper", "clustering": {"windw": 1}})
    assert [found["loc"] for found in error.value.errors()] == [("clustering", "windw")]
