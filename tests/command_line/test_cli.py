"""Manners of the command line: it starts at once, and its help is that of the commands."""

from __future__ import annotations

import signal
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version

import pytest
from typer.testing import CliRunner

import gpvo
from gpvo.commands.cli import COMMANDS, _loaded, app
from gpvo.errors import InputError

HEAVY = ("numba", "gtsam", "scipy", "cv2", "h5py", "matplotlib", "numpy")


def loaded_by(*arguments: str) -> tuple[str, set[str]]:
    """Return what the command prints, and the heavy packages that it loads."""
    code = (
        "import atexit, sys; from gpvo.commands.cli import main; sys.argv[0] = 'gpvo';"
        f"atexit.register(lambda: print('LOADED', *set(sys.modules) & set({HEAVY!r}))); main()"
    )
    ended = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    printed, _, loaded = ended.stdout.rpartition("LOADED")
    return printed, set(loaded.split())


def test_version_and_help_load_nothing_heavy() -> None:
    printed, loaded = loaded_by("--version")
    assert printed == f"gpvo {version('gpvo')}\n" and not loaded
    printed, loaded = loaded_by("-h")
    assert all(name in printed for name in COMMANDS) and not loaded


@pytest.mark.parametrize("name", list(COMMANDS))
def test_the_list_says_what_the_commands_say(name: str) -> None:
    command = COMMANDS[name]
    function = getattr(import_module(f"gpvo.commands.{command.module}"), command.function)
    assert function.__doc__.partition("\n")[0] == command.line
    shown = CliRunner().invoke(app, [name, "-h"])
    assert shown.exit_code == 0 and name in shown.output


def test_a_missing_cache_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: str) -> None:
        raise RuntimeError("set NUMBA_CACHE_DIR")

    monkeypatch.setattr("gpvo.commands.cli.import_module", refuse)
    with pytest.raises(InputError, match="set NUMBA_CACHE_DIR"):
        _loaded("gpvo.commands.nothing")


def test_python_m_gpvo_is_gpvo() -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "gpvo", "--version"], capture_output=True, text=True
    )
    assert ended.stdout == f"gpvo {version('gpvo')}\n"


def test_an_unknown_command_is_named() -> None:
    refused = CliRunner().invoke(app, ["nope"])
    assert refused.exit_code == 2 and "No such command 'nope'" in refused.output


def test_the_shell_completes_commands() -> None:
    environment = {"_GPVO_COMPLETE": "complete_bash", "COMP_WORDS": "gpvo co", "COMP_CWORD": "1"}
    completed = CliRunner().invoke(app, [], prog_name="gpvo", env=environment)
    assert completed.output.split() == ["config", "convert"]


def test_every_public_name_is_there() -> None:
    assert {name: getattr(gpvo, name) for name in gpvo.__all__}.keys() <= set(dir(gpvo))
    with pytest.raises(AttributeError, match="nothing"):
        _ = gpvo.nothing  # type: ignore[attr-defined]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_end_may_come_while_the_command_line_is_imported(number: signal.Signals) -> None:
    code = (
        "import os, sys; from gpvo.__main__ import main\n"
        "class Finder:\n"
        "    def find_spec(self, name, path, target=None):\n"
        f"        if name == 'typer': os.kill(os.getpid(), {int(number)})\n"
        "sys.meta_path.insert(0, Finder()); main()"
    )
    ended = subprocess.run([sys.executable, "-c", code, "-h"], capture_output=True, text=True)
    assert ended.returncode == 128 + number and not ended.stdout
    assert ended.stderr.startswith("gpvo: ") and ended.stderr.endswith("nothing was saved\n")
    assert ended.stderr.count("\n") == 1


def test_the_shell_completes_python_m_gpvo_as_gpvo() -> None:
    shown = subprocess.run(
        [sys.executable, "-m", "gpvo", "-h"], capture_output=True, text=True, check=True
    )
    assert "Usage: gpvo " in shown.stdout
