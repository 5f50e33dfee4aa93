"""Values that follow from the camera: the resolution that is tracked, and the units of pixels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factors import StereoCamera
from gpvo.config import (
    Configuration,
    NoiseConfig,
    StageConfig,
    TrackletConfig,
    for_camera,
    in_full_pixels,
    in_tracked_pixels,
)
from gpvo.config.stages import LARGEST_PATCH, KltConfig
from gpvo.estimator import FixedLagSmoother
from gpvo.front_end import FrontEnd
from gpvo.simulation import SimulationConfig

SIDES = {
    (240, 180): (1,),
    (346, 260): (1,),
    (640, 480): (1,),
    (1280, 720): (2,),
}
FOCAL_LENGTH = 226.0
positive = st.floats(1e-3, 1e3)


def tracked_at(*resolutions: int) -> Configuration:
    return Configuration.model_validate({"tracking": {"resolutions": resolutions}})


@pytest.mark.parametrize("size", SIDES)
def test_large_sensors_are_tracked_at_half_their_resolution(size: tuple[int, int]) -> None:
    found = for_camera(Configuration(), size, FOCAL_LENGTH)
    assert found.tracking.resolutions == SIDES[size]
    assert for_camera(found, size, FOCAL_LENGTH) == found
    klt = found.tracking.klt.model_copy(update={"patch_size": None})
    tracking = found.tracking.model_copy(update={"resolutions": None, "klt": klt})
    noise = found.noise.model_copy(update={"track_drift": None})
    found = found.model_copy(update={"tracking": tracking, "noise": noise})
    assert found == Configuration()


def patch(focal_length: float, size: tuple[int, int] = (346, 260)) -> int:
    found = for_camera(Configuration(), size, focal_length).tracking.klt.patch_size
    assert found is not None
    return found


@given(st.floats(10.0, 3000.0), st.floats(1.0, 2.0))
def test_patches_grow_with_the_root_of_the_focal_length_up_to_the_largest(
    focal_length: float, more: float
) -> None:
    side = patch(focal_length)
    assert side % 2 == 1 and 5 <= side <= LARGEST_PATCH == KltConfig().side
    assert side <= patch(focal_length * more)
    if 5 < side < LARGEST_PATCH:
        assert abs(side - 1.8 * np.sqrt(focal_length)) <= 1.0
    # At half the resolution the focal length is half as many pixels.
    assert patch(2 * focal_length, (1280, 720)) == side


@pytest.mark.parametrize("resolutions", [(1,), (2,), (1, 2)])
@pytest.mark.parametrize("size", SIDES)
def test_what_is_set_stays(size: tuple[int, int], resolutions: tuple[int, ...]) -> None:
    found = for_camera(tracked_at(*resolutions), size, FOCAL_LENGTH)
    assert found.tracking.resolutions == resolutions
    of_21 = Configuration.model_validate({"tracking": {"klt": {"patch_size": 21}}})
    assert for_camera(of_21, size, FOCAL_LENGTH).tracking.klt == of_21.tracking.klt


def changed(a: StageConfig, b: StageConfig, path: str = "") -> dict[str, float]:
    """Return the fields that differ, and the ratios of their values."""
    found: dict[str, float] = {}
    for name in type(a).model_fields:
        x, y = getattr(a, name), getattr(b, name)
        if isinstance(x, StageConfig):
            found |= changed(x, y, f"{path}{name}.")
        elif x != y:
            (ratio,) = set(np.divide(y, x).ravel().tolist())
            found[path + name] = ratio
    return found


def drift(focal_length: float, size: tuple[int, int] = (346, 260), **noise: float | None) -> float:
    given = Configuration.model_validate({"noise": noise})
    found = in_full_pixels(for_camera(given, size, focal_length)).noise.track_drift
    assert found is not None
    return found


@given(st.floats(10.0, 3000.0))
def test_tracks_move_on_landmarks_as_a_power_of_the_focal_length(focal_length: float) -> None:
    assert drift(28 ** (1 / 0.6)) == pytest.approx(1.0) and drift(225.0, track_drift=0.3) == 0.3
    assert drift(32 * focal_length) == pytest.approx(8 * drift(focal_length))
    whole, half = NoiseConfig(track_drift=None), (1280, 720)
    smoother = FixedLagSmoother(StereoCamera(focal_length, focal_length, 0, 0, 0.1), whole)
    assert smoother.noise.track_drift == drift(focal_length)
    # At half the resolution the same camera has half the focal length, and pixels twice as wide.
    assert drift(2 * focal_length, half) == pytest.approx(2 * drift(focal_length))


def test_lengths_of_the_sensor_are_twice_those_at_half_its_resolution() -> None:
    tracklets = TrackletConfig(min_length=2.0)
    of_226 = for_camera(tracked_at(2), (346, 260), 226.0)
    configuration = of_226.model_copy(update={"tracklets": tracklets})
    assert changed(configuration, in_full_pixels(configuration)) == {
        "tracklets.time_radius": 2,
        "tracklets.min_disparity": 2,
        "tracklets.min_length": 2,
        "mc_ransac.pixel_threshold": 2,
        "mc_ransac.disparity_tolerance": 2,
        "noise.measurement_information": 1 / 4,
        "noise.track_drift": 2,
    }
    for finest_is_full in (Configuration(), tracked_at(1), tracked_at(1, 2)):
        assert in_full_pixels(finest_is_full) == finest_is_full


@given(
    st.tuples(positive, positive, positive),
    positive,
    st.sampled_from([(1,), (2,), (2, 1)]),
)
def test_noise_in_pixels_of_the_sensor_and_back(
    information: tuple[float, float, float],
    drift: float,
    resolutions: tuple[int, ...],
) -> None:
    noise = NoiseConfig(measurement_information=information, track_drift=drift)
    configuration = tracked_at(*resolutions).model_copy(update={"noise": noise})
    assert in_tracked_pixels(in_full_pixels(configuration).noise, configuration) == noise


def test_the_front_end_measures_in_pixels_of_the_sensor() -> None:
    rig = SimulationConfig(resolution=(1280, 720)).rig
    front_end = FrontEnd(rig, Configuration())
    assert front_end.configuration == for_camera(Configuration(), (1280, 720), rig.focal_length)
    assert front_end.noise == in_full_pixels(front_end.configuration).noise
    deviation = 1 / np.sqrt(np.array(front_end.noise.measurement_information))
    usual = 1 / np.sqrt(np.array(Configuration().noise.measurement_information))
    np.testing.assert_allclose(deviation, 2 * usual)
