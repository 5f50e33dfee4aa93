"""A second process compiles the whole estimator, once, and never outlives the one that needs it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from gpvo.warm_up import beside
from gpvo.warm_up.beside import CompileBeside

COMPILED = """
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
"""
ESTIMATOR = (
    COMPILED
    + """
from gpvo import Configuration
from gpvo.warm_up.whole import warm_up
from gpvo.warm_up.known_points import estimate_from_points

packages = "factors.structureless", "factors.linear_states", "gpvo.estimator"
estimate_from_points(Configuration())
before = compiled(*packages)
warm_up(Configuration())
print(len(before) > 20, sorted(compiled(*packages) - before))
"""
)
LIVE = (
    COMPILED
    + """
from gpvo import Configuration, LiveOdometry
from gpvo.live.session import LiveSession
from gpvo.live.sources import RecordingPlayer
from gpvo.simulation import SimulationConfig, simulate
from gpvo.warm_up.whole import warm_up

class WithoutSome(RecordingPlayer):
    def packets(self):
        some = list(super().packets())
        yield from some[:100] + some[250:]

config = {"seed": 5, "resolution": (346, 260), "focal_length": 226.0, "noise_rate": 0.5}
room = simulate(SimulationConfig(duration=1.8, **config))
warm_up(Configuration())
before = compiled("factors", "gpvo")
live = LiveOdometry(room.rig)
LiveSession(live, room.rig, WithoutSome(room)).run()
live.close()
print(len(before) > 50, sorted(compiled("factors", "gpvo") - before))
"""
)


def test_what_the_estimator_needs_is_compiled() -> None:
    """A run from events needs no kernel of the estimator that known points do not need."""
    assert _output_of(ESTIMATOR) == "True []\n"
    assert beside._is_compiled()


def test_what_a_live_run_needs_is_compiled_before() -> None:
    """Also where events are missing, so that landmarks are lost and known again."""
    assert _output_of(LIVE) == "True []\n"


def _output_of(program: str) -> str:
    command = [sys.executable, "-c", program]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout


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
