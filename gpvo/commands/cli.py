"""The command line; `gpvo --help` lists its commands."""

from __future__ import annotations

import gc
import sys
from importlib import import_module
from types import ModuleType
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from gpvo.commands.interruption import end_at_once, end_by_exit
from gpvo.errors import InputError, OutputError

BAD_INPUT = 2
"""Exit status for bad input."""
NOT_WRITTEN = 4
"""Exit status for results that could not be written."""
HELP = {"help_option_names": ["-h", "--help"]}


class Command(NamedTuple):
    """Where a command's function is, which is imported when it is called.

    `line` is the first one of the function's docstring, known without importing it.
    """

    module: str
    function: str
    line: str


COMMANDS = {
    "run": Command(
        "run",
        "run",
        "Estimate the motion of a recording; write trajectory, metrics and plots.",
    ),
    "live": Command(
        "live",
        "live",
        "Estimate the motion while events come; Ctrl-C ends it and writes the results.",
    ),
    "view": Command(
        "view",
        "view",
        "Show path, uncertainty, velocities, landmarks and ground truth of a finished run.",
    ),
    "demo": Command(
        "demo",
        "demo",
        "Simulate a few seconds of stereo events and estimate the motion.",
    ),
    "eval": Command(
        "evaluate",
        "evaluate",
        "Compare estimates with the ground truth: tables, plots, report.",
    ),
    "tune-noise": Command(
        "tune_noise",
        "tune_noise",
        "Learn Q_c and R by maximum likelihood; print them as YAML for `--config`.",
    ),
    "config": Command(
        "config",
        "print_configuration",
        "Print a preset's configuration with a description of every field.",
    ),
    "inspect": Command(
        "inspect",
        "inspect_front_end",
        "Compare features, tracklets, times and MC-RANSAC with the truth: table, JSON, plots.",
    ),
    "info": Command(
        "info",
        "info",
        "Print what a recording holds: sensor, events, calibration, ground truth, faults.",
    ),
    "convert": Command(
        "convert",
        "convert_recording",
        "Write a recording in another format: the same events, and the calibration beside them.",
    ),
}


class LazyCommands(TyperGroup):
    """The commands, each imported when it is called: a list of them is there at once."""

    _listing = False

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the commands' names in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a command; for a list of them its first line is enough."""
        if cmd_name not in COMMANDS:
            return None
        command = COMMANDS[cmd_name]
        if self._listing:
            return TyperCommand(cmd_name, help=command.line)
        module = _loaded(f"gpvo.commands.{command.module}")
        one = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        one.command(cmd_name, context_settings=HELP)(getattr(module, command.function))
        return typer.main.get_command(one)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help without importing the commands."""
        self._listing = True
        super().format_help(ctx, formatter)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """Complete a command's name without importing the commands."""
        self._listing = True
        try:
            return super().shell_complete(ctx, incomplete)
        finally:
            self._listing = False


def _loaded(name: str) -> ModuleType:
    """Import a module, and leave what it loads out of garbage collection.

    It is there to stay. Looking for garbage in it took a fifth of the time that loading takes.
    """
    if name in sys.modules:
        return sys.modules[name]
    gc.disable()
    try:
        with end_at_once():
            return import_module(name)
    except RuntimeError as error:
        if "NUMBA_CACHE_DIR" in str(error):
            raise InputError(str(error)) from error
        raise
    finally:
        gc.freeze()
        gc.enable()


app = typer.Typer(
    cls=LazyCommands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings=HELP,
    help="Continuous-time visual odometry for stereo event cameras.",
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"gpvo {version('gpvo')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Continuous-time visual odometry for stereo event cameras."""


def main() -> None:
    """Run the command line; bad input gives one line on stderr and exit status 2.

    Results that cannot be written give exit status 4, Ctrl-C 130, SIGTERM 143.
    """
    try:
        with end_by_exit():
            app(prog_name="gpvo")
    except InputError as error:
        print(f"gpvo: {error}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except OutputError as error:
        print(f"gpvo: {error}", file=sys.stderr)
        sys.exit(NOT_WRITTEN)
