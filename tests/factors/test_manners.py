"""Factors check what they read, say what they are, and can be compared, copied and pickled."""

from __future__ import annotations

import copy
import gc
import pickle
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import gtsam
import numpy as np
import pytest
from graphs import CAMERA, NOISE, QC, random_states
from gtsam.symbol_shorthand import B, L, V, X
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core.runtime import _nrt_python, rtsys

from factors import (
    EuclideanVelocityFactor,
    GyroFactor,
    ImuFactor,
    InterpolatedFactor,
    InterpolatedStereoFactor,
    PointToPlaneFactor,
    PointToPointFactor,
    ReprojectionVelocityFactor,
    StereoReprojectionFactor,
    StructurelessStereoFactor,
    WnoaPriorFactor,
    check_values,
    from_dict,
    original,
    to_dict,
)
from factors.linear_states import LinearStatesFactor

DT = 0.1
MEASURED = np.array([180.0, 120.0, 6.0])
STATES = [gtsam.StateData(X(k), V(k), DT * k) for k in range(2)]
FACTORS: dict[str, Callable[[], Any]] = {
    "prior": lambda: WnoaPriorFactor(*STATES, QC),
    "stereo": lambda: StereoReprojectionFactor(MEASURED, NOISE, X(0), L(0), CAMERA),
    "between": lambda: InterpolatedStereoFactor(MEASURED, NOISE, *STATES, L(0), CAMERA, 0.04),
    "fast": lambda: EuclideanVelocityFactor([0, 0, 3], NOISE, V(0), [0, 0.1, 3], DT),
    "iterative": lambda: ReprojectionVelocityFactor(MEASURED, NOISE, V(0), [0, 0, 3], DT, CAMERA),
    "linear": lambda: LinearStatesFactor([X(0), V(0)], np.eye(4)[None], np.zeros((1, 6)), ROWS),
    "interpolated": lambda: InterpolatedFactor(
        gtsam.RangeFactor3D(0, L(0), 2.0, gtsam.noiseModel.Unit.Create(1)), *STATES, 0.04, qc=QC
    ),
    "point": lambda: PointToPointFactor([0, 0.1, 3], L(0), NOISE, X(0)),
    "plane": lambda: PointToPlaneFactor(
        [0, 0.1, 3], [0, 0, 1], 3.0, gtsam.noiseModel.Unit.Create(1), X(0)
    ),
    "gyro": lambda: GyroFactor([0.1, 0.2, 0.3], NOISE, V(0), B(0)),
    "imu": lambda: ImuFactor(preintegrated(), *STATES, B(0)),
    "structureless": lambda: StructurelessStereoFactor(
        [MEASURED] * 3, [0.01, 0.02, 0.05], 0, NOISE, STATES, CAMERA
    ),
}


def preintegrated() -> gtsam.PreintegratedImuMeasurements:
    """Ten measurements of a resting IMU."""
    found = gtsam.PreintegratedImuMeasurements(gtsam.PreintegrationParams.MakeSharedU(9.81))
    for _ in range(10):
        found.integrateMeasurement(np.array([0, 0, 9.81]), np.zeros(3), DT / 10)
    return found


ROWS = np.arange(26.0).reshape(2, 13)
each_factor = pytest.mark.parametrize("name", FACTORS)


def good_values(seed: int = 0) -> gtsam.Values:
    """Two states, a landmark and a bias."""
    values = random_states(seed, DT)
    values.insert(B(0), gtsam.imuBias.ConstantBias())
    return values


def values_of(sizes: dict[int, int]) -> gtsam.Values:
    """Good values, but for vectors of these sizes at some keys."""
    values = good_values()
    for key, size in sizes.items():
        values.erase(key)
        values.insert(key, np.zeros(size))
    return values


@each_factor
@pytest.mark.parametrize("size", [0, 1, 3, 5, 7, 12])
def test_a_value_of_another_size_is_an_error_that_names_it(name: str, size: int) -> None:
    factor = FACTORS[name]()
    for key in tuple(factor.keys()):
        fault = f"{gtsam.DefaultKeyFormatter(key)} .* must be .* not a (vector|Point).*"
        if gtsam.Symbol(key).chr() == ord("l") and size == 3:
            continue
        if isinstance(factor, gtsam.GenericStereoFactor3D) or name == "interpolated":
            fault = "(retrieve|must be)"  # GTSAM's own factor, and GTSAM's message
        for use in (factor.error, factor.linearize, factor.whitenedError):
            with pytest.raises((ValueError, RuntimeError), match=fault):
                use(values_of({key: size}))


@contextmanager
def only_new_objects_are_collected() -> Iterator[None]:
    """Have `gc.collect(1)` look at what is made inside alone: all other objects take long."""
    gc.collect(1)
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@each_factor
def test_kernels_free_what_they_allocate(name: str) -> None:
    values = good_values()
    FACTORS[name]().linearize(values)
    _nrt_python.memsys_enable_stats()
    with only_new_objects_are_collected():
        before = rtsys.get_allocation_stats()
        for _ in range(3):
            FACTORS[name]().linearize(values)
        gc.collect(1)
        after = rtsys.get_allocation_stats()
    assert after.alloc - before.alloc == after.free - before.free


@each_factor
def test_a_missing_key_and_swapped_types_are_errors_by_name(name: str) -> None:
    factor, good = FACTORS[name](), good_values()
    swapped = gtsam.Values(good)
    for k in range(2):
        swapped.erase(X(k))
        swapped.erase(V(k))
        swapped.insert(X(k), np.zeros(6))
        swapped.insert(V(k), gtsam.Pose3())
    for key in tuple(factor.keys()):
        missing = gtsam.Values(good)
        missing.erase(key)
        with pytest.raises((ValueError, RuntimeError), match=gtsam.DefaultKeyFormatter(key)):
            factor.error(missing)
    with pytest.raises((ValueError, RuntimeError), match=r"x0|v0|Vector|Pose3"):
        factor.linearize(swapped)


@pytest.mark.parametrize(
    "make",
    [
        lambda: WnoaPriorFactor(X(0), V(0), X(0), V(1), DT, QC),
        lambda: WnoaPriorFactor(STATES[0], gtsam.StateData(X(1), V(0), DT), QC),
        lambda: StereoReprojectionFactor(MEASURED, NOISE, X(0), X(0), CAMERA),
        lambda: InterpolatedStereoFactor(MEASURED, NOISE, *STATES, X(0), CAMERA, 0.04),
        lambda: LinearStatesFactor([X(0), X(0)], np.eye(4)[None], np.zeros((1, 6)), ROWS),
    ],
)
def test_the_same_key_twice_is_refused(make: Callable[[], Any]) -> None:
    with pytest.raises(ValueError, match="must not be the key of"):
        make()


def test_velocities_of_fixed_size_are_read() -> None:
    """As GTSAM's own WNOA functions write them."""
    values, factor = good_values(), FACTORS["prior"]()
    at = {gtsam.StateData(X(5), V(5), 0.04)}
    fixed = gtsam.updateInterpValuesPose3(gtsam.NonlinearFactorGraph(), values, set(STATES), at, QC)
    assert fixed.exists(V(5))
    with pytest.raises(RuntimeError):
        fixed.atVector(V(5))
    middle = gtsam.StateData(X(5), V(5), 0.04)
    prior = WnoaPriorFactor(STATES[0], middle, QC)
    dynamic = gtsam.Values(values)
    dynamic.insert(X(5), fixed.atPose3(X(5)))
    dynamic.insert(V(5), np.array(fixed.atVector6(V(5))))
    assert prior.error(fixed) == prior.error(dynamic) > 0
    assert factor.error(fixed) == factor.error(values)


@given(st.data())
@settings(deadline=None, max_examples=60)
def test_fuzzed_values_give_numbers_of_their_own_or_an_error(data: st.DataObject) -> None:
    """The same numbers from the same values, whatever was in memory before."""
    factor = FACTORS[data.draw(st.sampled_from(sorted(FACTORS)))]()
    values = gtsam.Values()
    for key in tuple(factor.keys()):
        kind = data.draw(st.sampled_from(["pose", "pose2", "vector", "none"]))
        if kind == "vector":
            size = data.draw(st.integers(0, 9))
            numbers = st.floats(width=64)
            values.insert(key, np.array(data.draw(st.lists(numbers, min_size=size, max_size=size))))
        elif kind != "none":
            values.insert(key, gtsam.Pose3() if kind == "pose" else gtsam.Pose2())
    found = []
    for _ in range(2):
        try:
            found.append(factor.linearize(values).augmentedJacobian())
        except (ValueError, RuntimeError) as error:
            found.append(str(error))
        FACTORS["prior"]().linearize(good_values(7))
    assert type(found[0]) is type(found[1])
    np.testing.assert_array_equal(found[0], found[1])


@each_factor
def test_what_a_factor_was_made_with_can_be_read_but_not_changed(name: str) -> None:
    factor = FACTORS[name]()
    for argument, value in factor._made_of.items():
        if callable(getattr(factor, argument)):  # a method has this name
            continue
        assert getattr(factor, argument) is value
        with pytest.raises(AttributeError, match="does not change"):
            setattr(factor, argument, 1)
        if isinstance(value, np.ndarray):
            with pytest.raises(ValueError, match="read-only"):
                value[...] = 0
    with pytest.raises(AttributeError, match="no speed"):
        factor.speed  # noqa: B018


@each_factor
def test_print_names_type_keys_arguments_and_noise(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    factor = FACTORS[name]()
    factor.print("here: ", lambda key: f"<{gtsam.DefaultKeyFormatter(key)}>")
    printed = capsys.readouterr().out
    assert printed.startswith(f"here: {type(factor).__name__} on <")
    assert "noise model: " in printed
    for key in tuple(factor.keys()):
        assert f"<{gtsam.DefaultKeyFormatter(key)}>" in printed
        assert gtsam.DefaultKeyFormatter(key) in repr(factor)
    for argument in ("dt", "qc", "measured", "camera"):
        assert (f"{argument}=" in printed) == (factor._made_of.get(argument) is not None)
    assert repr(factor).startswith(type(factor).__name__)
    assert "noise=" in repr(factor)
    assert "np.float64" not in repr(factor)


def test_keys_are_shown_by_their_names_and_long_texts_cut() -> None:
    factor = LinearStatesFactor([X(0), V(0)], np.eye(4)[None], np.zeros((1, 6)), np.ones((2, 13)))
    assert str(X(0)) not in repr(factor)
    assert all(len(repr(make())) < 600 for make in FACTORS.values())


def test_robust_noise_is_named_in_one_line() -> None:
    noise = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Huber(1.3), gtsam.noiseModel.Isotropic.Sigma(3, 0.5)
    )
    assert repr(PointToPointFactor([1, 2, 3], [1, 2, 3], noise, X(0))).endswith(
        "noise=Huber of Isotropic[0.5 0.5 0.5])"
    )


@each_factor
def test_copies_and_pickles_are_equal_and_do_the_same(name: str) -> None:
    factor, values = FACTORS[name](), good_values()
    for again in (pickle.loads(pickle.dumps(factor)), copy.copy(factor), copy.deepcopy(factor)):
        assert type(again) is type(factor)
        assert again.equals(factor)
        assert factor.equals(again)
        np.testing.assert_array_equal(
            again.linearize(values).augmentedJacobian(),
            factor.linearize(values).augmentedJacobian(),
        )


def test_factors_that_differ_are_not_equal() -> None:
    keys = X(0), V(0), X(1), V(1)
    factor = WnoaPriorFactor(*keys, DT, QC)
    assert factor.equals(WnoaPriorFactor(*keys, DT + 1e-12, QC))
    assert not factor.equals(WnoaPriorFactor(*keys, DT + 1e-3, QC))
    assert not factor.equals(WnoaPriorFactor(*keys, DT, 2 * QC))
    assert not factor.equals(WnoaPriorFactor(X(2), *keys[1:], DT, QC))
    assert not factor.equals(WnoaPriorFactor(*keys, DT, QC, approximate_jacobians=True))
    stereo = [StereoReprojectionFactor(MEASURED + d, NOISE, X(0), L(0), CAMERA) for d in (0, 0, 1)]
    assert stereo[0].equals(stereo[1])
    assert not stereo[0].equals(stereo[2])
    assert not stereo[0].equals(factor)
    custom = [gtsam.CustomFactor(NOISE, [9], lambda *_, n=n: np.full(3, n)) for n in (0.0, 1.0)]
    assert not factor.equals(custom[0])
    states = (X(0), V(0), 0.0), (X(1), V(1), DT)
    one, other = (InterpolatedFactor(inner, *states, DT / 2) for inner in custom)
    assert one.equals(InterpolatedFactor(custom[0], *states, DT / 2))
    assert not one.equals(other)
    seen = gtsam.StereoPoint2(180, 174, 120)
    one, other = (
        InterpolatedFactor(gtsam.GenericStereoFactor3D(seen, NOISE, 9, L(0), K), *states, DT / 2)
        for K in (gtsam.Cal3_S2Stereo(200, 200, 0, 160, 120, b) for b in (0.1, 0.2))
    )
    assert one.equals(copy.copy(one))
    assert not one.equals(other)


def test_what_gtsam_cannot_do_with_python_factors_is_as_the_docstring_says() -> None:
    graph, other, values = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph(), good_values()
    graph.add(FACTORS["prior"]())
    other.add(WnoaPriorFactor(X(0), V(0), X(1), V(1), 2 * DT, QC))
    for call in (
        graph.at(0).clone,
        lambda: graph.at(0).rekey([1, 2, 3, 4]),
        lambda: graph.at(0).cloneWithNewNoiseModel(gtsam.noiseModel.Unit.Create(12)),
        graph.serialize,
        lambda: pickle.dumps(graph),
        lambda: gtsam.GncLMOptimizer(graph, values, gtsam.GncLMParams()).optimize(),
    ):
        with pytest.raises(RuntimeError, match=r"clone|unregistered class"):
            call()
    assert graph.equals(other, 1e-9)  # which it should not
    again = from_dict(to_dict(graph))
    assert original(again.at(0)).equals(original(graph.at(0)))  # type: ignore[union-attr]


@each_factor
def test_a_graph_gives_back_our_object(name: str) -> None:
    """Also if nobody held it: then an equal one."""
    with only_new_objects_are_collected():
        graph, factor = gtsam.NonlinearFactorGraph(), FACTORS[name]()
        graph.add(factor)
        assert original(graph.at(0)) is factor
        del factor
        gc.collect(1)
    if name == "stereo":  # GTSAM's own, and GTSAM keeps all of it
        assert type(graph.at(0)) is gtsam.GenericStereoFactor3D
    else:
        found: Any = original(graph.at(0))
        assert found.equals(FACTORS[name]())


def test_other_factors_are_not_ours() -> None:
    unit = gtsam.noiseModel.Unit.Create(6)
    foreign = gtsam.CustomFactor(unit, [X(0)], lambda this, values, H: 1 / 0)
    for factor in (foreign, gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), unit), None):
        assert original(factor) is None


def test_factors_do_not_keep_themselves_alive() -> None:
    import weakref

    for make in FACTORS.values():
        factor = make()
        gone = weakref.ref(factor)
        del factor
        assert gone() is None


def test_an_update_can_be_checked_before_it_spoils_a_smoother() -> None:
    graph, values = gtsam.NonlinearFactorGraph(), good_values()
    unit = gtsam.noiseModel.Unit.Create(6)
    graph.add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), unit))
    graph.add(FACTORS["prior"]())
    check_values(graph, values)
    with pytest.raises(ValueError, match=r"factor 1 on x0 v0 x1 v1: .*v1 .velocity_j. must be"):
        check_values(graph, values_of({V(1): 3}))
    values.update(V(1), np.full(6, np.nan))
    with pytest.raises(ValueError, match=r"factor 1 .* not finite"):
        check_values(graph, values)
    values.erase(X(0))
    with pytest.raises(ValueError, match="factor 0 on x0"):
        check_values(graph, values)


def test_an_error_passes_through_gtsams_optimisers() -> None:
    graph, values = gtsam.NonlinearFactorGraph(), values_of({V(1): 3})
    graph.add(FACTORS["prior"]())
    for call in (
        lambda: graph.error(values),
        lambda: graph.linearize(values),
        lambda: gtsam.LevenbergMarquardtOptimizer(graph, values).optimize(),
    ):
        with pytest.raises(ValueError, match=r"v1 .velocity_j. must be a vector of 6"):
            call()


def test_a_traceback_does_not_show_what_gtsam_has_freed() -> None:
    """A debugger, or pytest, would crash on it."""
    factor, values = FACTORS["prior"](), values_of({V(1): 3})
    with pytest.raises(ValueError, match="v1") as caught:
        factor.linearize(values)
    found: list[object] = []
    error: BaseException | None = caught.value
    while error is not None:
        for frame, _ in traceback.walk_tb(error.__traceback__):
            found += list(frame.f_locals.values())
        error = error.__cause__
    assert found
    assert not any(isinstance(each, gtsam.JacobianVector) for each in found)
    assert not any(type(each) is gtsam.CustomFactor for each in found)


def test_a_key_whose_name_is_no_text_is_shown_as_its_number(
    capsys: pytest.CaptureFixture[str],
) -> None:
    factor = WnoaPriorFactor(2**63, V(0), X(1), V(1), DT, QC)
    assert repr(factor).startswith(f"WnoaPriorFactor({2**63}, v0")
    factor.print()
    assert str(2**63) in capsys.readouterr().out
    with pytest.raises(ValueError, match=f"{2**63} .pose_i. is not in the values"):
        factor.error(good_values())
