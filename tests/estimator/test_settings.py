"""Settings of earlier versions are one clear error that names what is there instead."""

from __future__ import annotations

import pytest
from pydantic import ValidationError
from synthetic import CAMERA

import gpvo
from gpvo import Configuration, FixedLagSmoother
from gpvo.config import EstimatorConfig, NoiseConfig
from gpvo.estimator import make_estimator
from gpvo.estimator.batch_window import SlidingWindow

OLD = [
    ({"method": "gauss_newton"}, "fixed_lag"),
    ({"loss": "gnc"}, "geman_mcclure"),
    ({"landmarks": "variables"}, "leave it out"),
    ({"landmarks": "eliminated"}, "leave it out"),
]


@pytest.mark.parametrize("settings, instead", OLD)
def test_what_earlier_versions_had_names_what_is_there_now(
    settings: dict[str, str], instead: str
) -> None:
    for make in (
        lambda: EstimatorConfig(**settings),  # type: ignore[arg-type]
        lambda: EstimatorConfig.model_validate(settings),
        lambda: Configuration.model_validate({"estimator": settings}),
    ):
        with pytest.raises(ValidationError) as error:
            make()
        (found,) = error.value.errors()
        assert instead in found["msg"]
        ((field, value),) = settings.items()
        assert field in found["msg"] and value in found["msg"]


@pytest.mark.parametrize(
    "settings", [{"method": "isam"}, {"loss": "welsch"}, {"window": 1}, {"lag": 0.0}, {"gate": 1.0}]
)
def test_values_that_are_none_are_an_error_of_their_field(settings: dict[str, object]) -> None:
    with pytest.raises(ValidationError) as error:
        EstimatorConfig.model_validate(settings)
    assert [found["loc"] for found in error.value.errors()] == [tuple(settings)]


def test_defaults_are_gtsams_fixed_lag_smoother_at_unique_times() -> None:
    config = EstimatorConfig()
    assert (config.method, config.state_interval, config.loss) == ("fixed_lag", 0.0, "none")
    assert NoiseConfig().track_drift == 0.25
    with pytest.raises(ValidationError, match="track_drift"):
        NoiseConfig(track_drift=-0.1)
    assert isinstance(make_estimator(CAMERA, NoiseConfig(), config), FixedLagSmoother)
    batch = EstimatorConfig(method="batch")
    assert isinstance(make_estimator(CAMERA, NoiseConfig(), batch), SlidingWindow)


def test_what_users_need_is_imported_from_the_package() -> None:
    names = "FixedLagSmoother Measurements Configuration Odometry Trajectory open_recording"
    assert set(names.split()) <= set(gpvo.__all__)
    assert all(hasattr(gpvo, name) for name in gpvo.__all__)
