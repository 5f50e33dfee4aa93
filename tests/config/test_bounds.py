"""Values that memory or time would not suffice for are one clear error of their field."""

from __future__ import annotations

from pathlib import Path

import pytest

from gpvo.config import Configuration, load_configuration
from gpvo.errors import InputError

HUGE = 10**30
TOO_MUCH = [
    ("clustering", "window", 1e-9),
    ("tracking", "earlier_frames", HUGE),
    ("tracking.klt", "patch_size", 100_000),
    ("tracking.klt", "pyramid_levels", HUGE),
    ("tracking.klt", "spacing", HUGE),
    ("tracking.viso2", "flow_radius", HUGE),
    ("tracking.viso2", "max_disparity", HUGE),
    ("tracking.viso2", "row_tolerance", HUGE),
    ("tracking.viso2", "range_cell", HUGE),
    ("tracking.viso2", "bucket_size", HUGE),
    ("tracklets", "history", HUGE),
    ("mc_ransac", "iterations", 10**9),
    ("mc_ransac", "sample_size", HUGE),
    ("mc_ransac", "refinement_iterations", HUGE),
    ("noise", "initial_velocity", 1e-200),
    ("noise", "initial_velocity", 1e200),
    ("estimator", "window", HUGE),
    ("estimator", "state_interval", 1e-9),
    ("estimator", "covariance_interval", 1e-9),
]


@pytest.mark.parametrize(("stage", "field", "value"), TOO_MUCH)
def test_what_memory_or_time_does_not_suffice_for_is_one_clear_error(
    stage: str, field: str, value: float, tmp_path: Path
) -> None:
    file, content = tmp_path / "config.yaml", f"{field}: {value}"
    for name in reversed(stage.split(".")):
        content = f"{name}: {{{content}}}"
    file.write_text(content)
    with pytest.raises(InputError, match=rf"config\.yaml: {stage}\.{field}: ") as error:
        load_configuration(file)
    assert "\n" not in str(error.value)


def test_a_resolution_is_tracked_once(tmp_path: Path) -> None:
    file = tmp_path / "config.yaml"
    file.write_text("tracking: {resolutions: [1, 1]}")
    with pytest.raises(InputError, match=r"tracking\.resolutions: .*once"):
        load_configuration(file)
    assert Configuration.model_validate({"tracking": {"resolutions": [2, 1]}}).tracking.pixel == 1


@pytest.mark.parametrize("interval", [0.0, 0.001, 0.025, 10.0])
def test_key_states_are_at_unique_times_or_apart(interval: float) -> None:
    found = Configuration.model_validate({"estimator": {"state_interval": interval}})
    assert found.estimator.state_interval == interval
