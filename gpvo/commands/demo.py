"""`gpvo demo`: simulate a recording, and estimate its motion."""

from __future__ import annotations

from gpvo.commands.inputs import Output, Seed, configured, console
from gpvo.commands.map_error import map_error
from gpvo.commands.result import FILES
from gpvo.commands.run_and_write import run_and_write
from gpvo.evaluation.report.result_folder import claim_folder, new_folder
from gpvo.mapping.scene_file import SCENE_FILE, write_scene
from gpvo.simulation import SimulationConfig, simulate


def demo(output: Output = None, seed: Seed = None) -> None:
    """Simulate a few seconds of stereo events and estimate the motion."""
    simulation = SimulationConfig(seed=1 if seed is None else seed, duration=2.0)
    with console.status("simulating stereo events of a textured room"):
        recording = simulate(simulation)
    folder = claim_folder(output or new_folder("demo"), FILES)
    configuration = configured(None, seed)
    run_and_write(recording, configuration, folder, recording.ground_truth, console)
    write_scene(folder / SCENE_FILE, recording.scene.boxes)
    error = map_error(folder)
    if error is not None:
        console.print(str(error), highlight=False)
