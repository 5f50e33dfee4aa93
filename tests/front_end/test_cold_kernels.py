"""The process that compiles kernels finds the same, bit for bit, as the next that loads them."""

from __future__ import annotations

import dis
import gc
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from numba.core.registry import CPUDispatcher

import gpvo.front_end
import gpvo.odometry  # noqa: F401

KERNELS = [each for each in gc.get_objects() if isinstance(each, CPUDispatcher)]


@cache
def called_by(kernel: CPUDispatcher) -> list[CPUDispatcher]:
    function, steps = kernel.py_func, dis.get_instructions(kernel.py_func)
    names = {step.argval for step in steps if step.opname == "LOAD_GLOBAL"}
    called = map(function.__globals__.get, sorted(names))
    return [each for each in called if isinstance(each, CPUDispatcher)]


@cache
def sums_in_any_order(kernel: CPUDispatcher) -> bool:
    fast = bool(kernel.targetoptions.get("fastmath"))
    return fast or any(map(sums_in_any_order, called_by(kernel)))


IN_ANY_ORDER = sorted(
    filter(sums_in_any_order, KERNELS), key=lambda kernel: (kernel.__module__, kernel.__name__)
)


@pytest.mark.parametrize("kernel", IN_ANY_ORDER, ids=lambda kernel: kernel.__name__)
def test_kernels_are_inlined_whose_sums_are_in_any_order(kernel: CPUDispatcher) -> None:
    """Else their callers have copies of them with other orders."""
    called = filter(sums_in_any_order, called_by(kernel))
    assert all(each.targetoptions.get("forceinline") for each in called)


def test_a_process_that_compiles_finds_the_same_as_the_next(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    folder = Path(__file__).parent
    command = [sys.executable, "found_by_kernels.py"]
    cold, warm = (
        subprocess.run(command, env=environment, cwd=folder, stdout=subprocess.PIPE, check=True)
        for _ in range(2)
    )
    assert len(cold.stdout.split()) == 3 * 41
    assert cold.stdout == warm.stdout
