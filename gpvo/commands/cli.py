"""The command line; `gpvo --help` lists its commands."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from gpvo.commands.convert import convert_recording
from gpvo.commands.evaluate import evaluate
from gpvo.commands.info import info
from gpvo.commands.inspect import inspect_front_end
from gpvo.commands.live import live
from gpvo.commands.run import demo, run
from gpvo.commands.tune_noise import tune_noise
from gpvo.config import PRESETS, Configuration, configuration_text
from gpvo.errors import InputError

BAD_INPUT = 2
"""Exit status for bad input."""

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Continuous-time visual odometry for stereo event cameras.",
)


def main() -> None:
    """Run the command line; bad input gives one line on stderr and exit status 2."""
    try:
        app()
    except InputError as error:
        print(f"gpvo: {error}", file=sys.stderr)
        sys.exit(BAD_INPUT)


def _known(preset: str) -> str:
    """Return the preset's name; one that is none ends the command."""
    if preset not in PRESETS:
        raise typer.BadParameter(f"{preset} is none of {', '.join(PRESETS)}")
    return preset


def print_configuration(
    preset: Annotated[str, typer.Option(help=f"{' or '.join(PRESETS)}.", callback=_known)] = "auto",
) -> None:
    """Print a preset's configuration with a description of every field."""
    configuration = Configuration.model_validate({"preset": preset})
    print(configuration_text(configuration, described=True), end="")


app.command()(run)
app.command()(live)
app.command()(demo)
app.command(name="eval")(evaluate)
app.command(name="tune-noise")(tune_noise)
app.command(name="config")(print_configuration)
app.command(name="inspect")(inspect_front_end)
app.command()(info)
app.command(name="convert")(convert_recording)
