"""Cost of a result: time by stage, memory, and the machine."""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from gpvo.errors import InputError
from gpvo.evaluation.report.compilation import CompilationTimer
from gpvo.evaluation.report.machine import machine
from gpvo.evaluation.report.table import Cell, ResultTable

COST_FILE = "cost.json"
"""File in a result folder, the only one that differs between equal runs."""


@dataclass(frozen=True)
class Cost:
    """Time and memory of processing one recording.

    Attributes
    ----------
    recording_seconds, events
        Duration and events of both cameras that were processed.
    wall_seconds, cpu_seconds
        Elapsed time, and processor time of all threads, both without compiling or
        loading kernels.
    peak_memory_bytes
        Largest resident memory of the process since it started.
    stages
        Elapsed seconds by stage, without those in which any thread compiles or loads kernels. A
        cluster is tracked while the one before is estimated, so that they may add up to more than
        the whole; new landmarks are found beside both, which is in no stage.
    machine
        Description of the machine, see `machine`; empty if unknown, or for several machines.
    compile_seconds
        Elapsed time in which kernels were compiled, which the first run of an installation does, or
        loaded, as every process does.
    """

    recording_seconds: float
    events: int
    wall_seconds: float
    cpu_seconds: float
    peak_memory_bytes: int
    stages: dict[str, float] = field(default_factory=dict)
    machine: dict[str, Any] = field(default_factory=dict)
    compile_seconds: float = 0.0

    @property
    def real_time_factor(self) -> float:
        """Recorded seconds processed in one second; 1 keeps up with the camera."""
        return self.recording_seconds / self.wall_seconds

    @property
    def events_per_second(self) -> float:
        """Events of both cameras processed in one second."""
        return self.events / self.wall_seconds

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers by name."""
        derived = {
            "real_time_factor": self.real_time_factor,
            "events_per_second": self.events_per_second,
        }
        return {**asdict(self), **derived}


@dataclass
class CostMeter:
    """Stopwatch for stages, which run one after the other or repeatedly.

    >>> meter = CostMeter()
    >>> with meter.stage("tracking"):
    ...     pass
    >>> cost = meter.total(recording_seconds=10.0, events=1_000_000)
    """

    stages: dict[str, float] = field(default_factory=dict)
    compilation: CompilationTimer = field(default_factory=CompilationTimer)
    _wall: float = field(default_factory=time.perf_counter)
    _cpu: float = field(default_factory=time.process_time)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time spent inside the context to a stage."""
        start = self.clock()
        try:
            yield
        finally:
            self.stages[name] = self.stages.get(name, 0.0) + self.clock() - start

    def clock(self) -> float:
        """Return a time, seconds, that stands still while kernels are compiled or loaded."""
        return time.perf_counter() - self.compilation.elapsed()

    def total(self, recording_seconds: float, events: int) -> Cost:
        """Return the cost since the meter was made, and stop it."""
        compiling = self.compilation.stop()
        return Cost(
            recording_seconds=recording_seconds,
            events=events,
            wall_seconds=time.perf_counter() - self._wall - compiling,
            cpu_seconds=time.process_time() - self._cpu - self.compilation.cpu_seconds,
            peak_memory_bytes=peak_memory_bytes(),
            compile_seconds=compiling,
            stages=dict(self.stages),
            machine=machine(),
        )


def total_cost(costs: Iterable[Cost]) -> Cost:
    """Add up the costs of several runs; memory is the largest of them."""
    every = list(costs)
    alike = all(cost.machine == every[0].machine for cost in every)
    stages = dict.fromkeys(stage for cost in every for stage in cost.stages)
    return Cost(
        recording_seconds=sum(cost.recording_seconds for cost in every),
        events=sum(cost.events for cost in every),
        wall_seconds=sum(cost.wall_seconds for cost in every),
        cpu_seconds=sum(cost.cpu_seconds for cost in every),
        peak_memory_bytes=max(cost.peak_memory_bytes for cost in every),
        compile_seconds=sum(cost.compile_seconds for cost in every),
        stages={stage: sum(cost.stages.get(stage, 0.0) for cost in every) for stage in stages},
        machine=every[0].machine if alike else {},
    )


def write_cost(folder: Path, cost: Cost) -> None:
    """Write the cost of a result into its folder."""
    (folder / COST_FILE).write_text(json.dumps(cost.to_dict(), indent=2) + "\n", encoding="utf-8")


def read_cost(result: Path) -> Cost | None:
    """Read the cost of a result folder, or of a trajectory file in it; None if there is none.

    Raises
    ------
    InputError
        If the file does not hold a cost.
    """
    folder = result.parent if result.stem == "trajectory" else result
    path = folder / COST_FILE
    if not path.exists():
        return None
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        names = [one.name for one in fields(Cost) if one.name in values]
        return Cost(**{name: values[name] for name in names})
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is no cost that gpvo run wrote; remove it") from error


def peak_memory_bytes() -> int:
    """Return the largest resident memory of this process so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak  # Linux counts kilobytes


def cost_table(costs: Mapping[str, Cost], sequence: str = "") -> ResultTable:
    """Return a table of speed, processor time, memory, and every stage's speed and share of time.

    Every result has a column. A stage's speed is the one it would reach alone, in multiples of real
    time.
    """
    stages = dict.fromkeys(stage for cost in costs.values() for stage in cost.stages)
    labels = [
        "speed",
        "events per second",
        "CPU s per recorded s",
        "peak memory",
        "loading kernels",
    ]
    columns = [[*_totals(cost), *_stages(cost, stages)] for cost in costs.values()]
    every = [*labels, *stages]
    rows = [tuple(map(Cell, entries)) for entries in zip(every, *columns, strict=True)]
    title = f"{sequence}: cost" if sequence else "Cost"
    return ResultTable(title, ("", *costs), tuple(rows), group=len(rows))


def _totals(cost: Cost) -> list[str]:
    return [
        f"{cost.real_time_factor:.2f} x real time",
        f"{1e-6 * cost.events_per_second:.2f} M",
        f"{cost.cpu_seconds / cost.recording_seconds:.2f}",
        f"{cost.peak_memory_bytes / 2**20:.0f} MiB",
        f"{cost.compile_seconds:.1f} s, not counted" if cost.compile_seconds else "none",
    ]


def _stages(cost: Cost, stages: Iterable[str]) -> list[str]:
    spent = (cost.stages.get(stage, 0.0) for stage in stages)
    return [_stage(cost, seconds) if seconds > 0.0 else "–" for seconds in spent]


def _stage(cost: Cost, seconds: float) -> str:
    share = 100.0 * seconds / cost.wall_seconds
    return f"{cost.recording_seconds / seconds:.2f} x, {share:.1f} %"
