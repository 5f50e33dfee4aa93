"""A second process compiles the whole estimator, once, and never outlives the one that needs it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from gpvo.warm_up import beside
from gpvo.warm_up.beside import CompileBeside

PROGRAM = """
import gc
from numba.core.registry import CPUDispatcher

def compiled(*packages):
    dispatchers = (each for each in gc.get_objects() if isinstance(each, CPUDispatcher))
    functions = ((each.py_func.__module__, each.py_func.__name__, each) for each in dispatchers)
    return {
        (module, name, str(signature))
        for module, name, each in functions
        if module.startswith(packages)
        for signature in each.signatures
    }

from gpvo import Configuration, LiveOdometry
from gpvo.live.session import LiveSession
from gpvo.live.sources import RecordingPlayer
from gpvo.simulation import SimulationConfig, simulate
from gpvo.warm_up.known_points import estimate_from_points
from gpvo.warm_up.whole import warm_up

config = {"seed": 5, "resolution": (240, 180), "focal_length": 160.0, "noise_rate": 0.5}
room = simulate(SimulationConfig(duration=1.8, **config))
estimator = "factors.structureless", "factors.linear_states", "gpvo.estimator"
estimate_from_points(Configuration())
by_points = compiled(*estimator)
warm_up(Configuration())
print(len(by_points) > 20, sorted(compiled(*estimator) - by_points))

class WithoutSome(RecordingPlayer):
    def packets(self):
        some = list(super().packets())
        yield from some[:100] + some[250:]

before = compiled("factors", "gpvo")
live = LiveOdometry(room.rig)
LiveSession(live, room.rig, WithoutSome(room)).run()
live.close()
print(len(before) > 50, sorted(compiled("factors", "gpvo") - before))
"""


@pytest.fixture(scope="module")
def said() -> list[str]:
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    return done.stdout.splitlines()


def test_what_the_estimator_needs_is_compiled(said: list[str]) -> None:
    """A run from events needs no kernel of the estimator that known points do not need."""
    assert said[0] == "True []"
    assert beside._is_compiled()


def test_what_a_live_run_needs_is_compiled_before(said: list[str]) -> None:
    """Also where events are missing, so that landmarks are lost and known again."""
    assert said[1] == "True []"


def test_nothing_is_begun_where_it_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "_is_compiled", lambda: True)
    with CompileBeside() as process:
        process.start()
        assert process._process is None


def test_it_ends_with_its_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "_is_compiled", lambda: False)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    with CompileBeside() as process:
        process.start()
        begun = process._process
        process.start()
        assert process._process is begun is not None
        assert begun.poll() is None
    assert begun.returncode is not None


def test_one_processor_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "_is_compiled", lambda: False)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    with CompileBeside() as process:
        process.start()
        assert process._process is None
