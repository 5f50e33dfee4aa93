"""Compiling is timed once, whatever is nested in it, and what is compiled already costs nothing."""

from __future__ import annotations

import json
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from subprocess import check_output as run

import pytest
from numba import njit
from numba.core.event import trigger_event

from gpvo.evaluation.report.compilation import COMPILING_OR_LOADING, CompilationTimer
from gpvo.evaluation.report.run_time import CostMeter

KERNELS = """
import json
from numba import njit
from gpvo.evaluation.report.compilation import CompilationTimer

@njit(cache=True)
def twice(x):
    return 2 * x

said = []
timer = CompilationTimer(lambda: said.append(1))
twice(1.0)
print(json.dumps(dict(said=len(said), seconds=timer.stop(), cpu_seconds=timer.cpu_seconds)))
"""


def fresh() -> object:
    """Return a function that is not compiled yet, and calls another one."""

    @njit
    def inner(x: float) -> float:
        return x + 1

    @njit
    def outer(x: float) -> float:
        return 2 * inner(x)

    return outer


def test_compiling_is_said_once_and_its_time_is_within_the_call() -> None:
    said: list[str] = []
    timer, call = CompilationTimer(lambda: said.append("compiling")), fresh()
    begin = time.perf_counter()
    assert call(1.0) == 4.0  # type: ignore[operator]
    elapsed = time.perf_counter() - begin
    assert said == ["compiling"]
    assert 0.1 * elapsed < timer.seconds <= elapsed
    first = timer.seconds
    assert call(2.0) == 6.0  # type: ignore[operator]
    assert timer.stop() == first


def test_what_was_compiled_before_is_loaded_without_a_word(tmp_path: Path) -> None:
    """In a second process; its time counts as that of compiling does."""
    (tmp_path / "kernels.py").write_text(KERNELS)
    said = [run([sys.executable, "kernels.py"], cwd=tmp_path) for _ in range(2)]
    compiled, loaded = (json.loads(one) for one in said)
    assert compiled["said"] == 1 and loaded["said"] == 0
    assert compiled["seconds"] > 0 and loaded["seconds"] > 0
    assert loaded["cpu_seconds"] > 0


def test_threads_that_wait_for_each_other_count_once() -> None:
    timer = CompilationTimer()
    begin = time.perf_counter()
    with ThreadPoolExecutor(2) as threads:
        for call in [fresh() for _ in range(4)]:
            threads.submit(call, 1.0)  # type: ignore[arg-type]
    assert 0 < timer.stop() <= time.perf_counter() - begin


def test_nothing_counts_after_the_end() -> None:
    timer = CompilationTimer()
    timer.stop()
    fresh()(1.0)  # type: ignore[operator]
    assert timer.seconds == 0.0


def test_the_cost_of_a_run_is_without_compiling() -> None:
    begin = time.perf_counter()
    meter = CostMeter()
    fresh()(1.0)  # type: ignore[operator]
    cost = meter.total(1.0, 1)
    assert cost.compile_seconds > 0
    assert cost.wall_seconds + cost.compile_seconds <= time.perf_counter() - begin


def test_stages_are_without_what_any_thread_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(time, "perf_counter", lambda: now)
    meter = CostMeter()
    with meter.stage("tracking"):
        now += 1.0
        with trigger_event(COMPILING_OR_LOADING):
            now += 10.0
            with meter.stage("estimation"):
                now += 10.0
        with meter.stage("estimation"):
            now += 2.0
    assert meter.stages == {"tracking": 3.0, "estimation": 2.0}


def test_processor_time_of_a_run_is_not_negative_on_a_busy_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Compiling that waits for the processor takes more elapsed time than processor time."""
    meter, clock = CostMeter(), time.perf_counter
    with trigger_event(COMPILING_OR_LOADING):
        monkeypatch.setattr(time, "perf_counter", lambda: clock() + 100.0)
    cost = meter.total(recording_seconds=1.0, events=1)
    assert cost.compile_seconds > 100.0
    assert cost.cpu_seconds >= 0.0
