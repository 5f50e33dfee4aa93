"""What `gpvo inspect` does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console

from gpvo.config.stages import Configuration
from gpvo.config.yaml_file import configuration_text, load_fields
from gpvo.errors import InputError
from gpvo.evaluation.front_end.inspect import inspect
from gpvo.evaluation.front_end.report import FILES, inspection_table, write_inspection
from gpvo.evaluation.front_end.summary import summarize
from gpvo.evaluation.front_end.truth import Truth, truth_of_simulation
from gpvo.evaluation.report.result_folder import make_folder
from gpvo.recordings import Recording
from gpvo.run_command import check_start
from gpvo.simulation.recording import SimulatedRecording, SimulationConfig, simulate


def simulated(path: Path) -> SimulatedRecording:
    """Simulate the recording that a YAML file with fields of `SimulationConfig` describes.

    Raises
    ------
    InputError
        If the file cannot be read or a field is wrong.
    """
    fields = ", ".join(SimulationConfig.model_fields)
    return simulate(load_fields(path, SimulationConfig, f"the fields are {fields}"))


def inspect_command(
    recording: Recording,
    truth: Truth | None,
    configuration: Configuration,
    folder: Path,
    console: Console,
    start: float = 0.0,
    duration: float = np.inf,
) -> None:
    """Inspect a recording; print the table and write everything into the folder."""
    if truth is None:
        if not isinstance(recording, SimulatedRecording):
            raise InputError(f"{recording.path}: to be inspected needs --ground-truth FILE")
        truth = truth_of_simulation(recording)
    check_start(recording, start)
    make_folder(folder, FILES)
    with console.status("inspecting the front end") as status:
        clusters = inspect(
            recording,
            truth,
            configuration,
            start,
            duration,
            lambda cluster: status.update(f"inspecting the front end: {cluster.stop:.2f} s"),
        )
    summary = summarize(clusters)
    write_inspection(folder, clusters, summary, recording.rig.resolution[0])
    (folder / "config.yaml").write_text(configuration_text(configuration))
    console.print(inspection_table(summary))
    console.print(f"results: {folder}")
