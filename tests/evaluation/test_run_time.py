"""Sums of stages and runs, factors of speed, memory and machine."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest

from gpvo.errors import InputError
from gpvo.evaluation.report.machine import machine, machine_text
from gpvo.evaluation.report.run_time import (
    Cost,
    CostMeter,
    cost_table,
    peak_memory_bytes,
    read_cost,
    total_cost,
    write_cost,
)


def test_stages_add_up_within_the_total():
    meter = CostMeter()
    for _ in range(3):
        with meter.stage("tracking"):
            np.linalg.inv(np.eye(100))
    with pytest.raises(KeyError), meter.stage("smoother"):
        raise KeyError
    cost = meter.total(recording_seconds=10.0, events=1000)
    assert set(cost.stages) == {"tracking", "smoother"}
    assert 0.0 < sum(cost.stages.values()) <= cost.wall_seconds


def test_factors():
    cost = Cost(10.0, 4_000_000, 5.0, 8.0, 2**30, {"tracking": 2.0})
    assert cost.real_time_factor == 2.0
    assert cost.events_per_second == 800_000.0
    assert json.loads(json.dumps(cost.to_dict()))["stages"]["tracking"] == 2.0
    cells = {row[0].text: row[1].text for row in cost_table({"gpvo": cost}).rows}
    assert cells == {
        "speed": "2.00 x real time",
        "events per second": "0.80 M",
        "CPU s per recorded s": "0.80",
        "peak memory": "1024 MiB",
        "loading kernels": "none",
        "tracking": "5.00 x, 40.0 %",
    }


def test_costs_of_several_runs_add_up():
    one = Cost(10.0, 4_000_000, 5.0, 8.0, 2**30, {"tracking": 2.0})
    other = Cost(5.0, 1_000_000, 20.0, 12.0, 2**29, {"tracking": 1.0, "estimation": 9.0})
    stages = {"tracking": 3.0, "estimation": 9.0}
    assert total_cost([one, other]) == Cost(15.0, 5_000_000, 25.0, 20.0, 2**30, stages)
    assert total_cost([one]) == one
    here = replace(one, machine={"cores": 2})
    assert total_cost([here, here]).machine == {"cores": 2}
    assert total_cost([here, other]).machine == {}


def test_peak_memory_is_in_bytes():
    """It is more than an array in use, and less than the machine's memory."""
    held = np.ones(10_000_000)
    installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    assert held.nbytes < peak_memory_bytes() < installed


def test_the_machine_names_what_matters():
    facts = machine()
    assert facts["processor"]
    assert facts["cores"] >= 1
    assert facts["packages"]["numpy"] == np.__version__
    assert f"numpy {np.__version__}" in machine_text(facts)


def test_a_cost_is_read_as_it_was_written(tmp_path):
    assert read_cost(tmp_path) is None
    cost = CostMeter({"tracking": 0.1}).total(recording_seconds=10.0, events=1000)
    write_cost(tmp_path, cost)
    assert cost.machine == machine()
    assert read_cost(tmp_path) == read_cost(tmp_path / "trajectory.npz") == cost
    assert read_cost(tmp_path / "esvo.txt") is None
    (tmp_path / "cost.json").write_text("[]")
    with pytest.raises(InputError, match=r"cost\.json: is no cost"):
        read_cost(tmp_path)
