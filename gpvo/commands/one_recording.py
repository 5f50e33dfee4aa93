"""The run of one recording of many, in a process of its own.

Workers of a cluster import this module and nothing else of the package, so that they start at once.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Outcome:
    """How the run of a recording ended.

    Attributes
    ----------
    name
        Of the recording, and of its folder.
    status
        Exit status of `gpvo run`.
    said
        The last line that it printed.
    """

    name: str
    status: int
    said: str


def run_one(name: str, given: Sequence[str], folder: str) -> Outcome:
    """Run `gpvo` with these arguments in a process; what it prints goes to a file beside."""
    log = Path(folder) / f"{name}.log"
    command = [sys.executable, "-m", "gpvo.commands.one_of_many", *given]
    with (
        log.open("wb") as text,
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=text, stderr=subprocess.STDOUT
        ) as process,
    ):
        code = process.wait()
    lines = log.read_text(encoding="utf-8", errors="replace").split("\n")
    said = next((line.strip() for line in reversed(lines) if line.strip()), "said nothing")
    return Outcome(name, code if code >= 0 else 128 - code, said)
