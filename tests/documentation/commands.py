"""Commands of the documentation: run here, or known to be run elsewhere."""

from __future__ import annotations

import re
import shlex
import sys

import pytest
from pages import REPOSITORY

from gpvo.commands.cli import main

ELSEWHERE = {
    r"python3 -m venv .venv": ".ci/run",
    r"\.venv/bin/pip install \.": ".ci/package",
    r"\.venv/bin/pip install --editable .*": ".ci/run",
    r"\.venv/bin/gpvo demo": "tests/documentation/test_readme.py",
    r"\.venv/bin/python -m pytest.*": ".ci/run",
    r"\.venv/bin/(ruff|mypy|mkdocs).*": ".ci/run",
    r"\.ci/run": ".ci/run",
    r"pip install \./factors": ".ci/package",
    r"pip install --constraint .*": "tests/packaging/test_constraints.py",
    r"pip install .*": ".ci/package",
    r"pip show gpvo": ".ci/package",
    r"git clone .*": ".ci/run",
}
"""What other tests run, and where."""


def run(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a command of gpvo; of others check that they are run elsewhere."""
    if command.startswith("gpvo "):
        monkeypatch.setattr(sys, "argv", shlex.split(command))
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code, command
    else:
        assert is_run_elsewhere(command), command


def is_run_elsewhere(command: str) -> bool:
    """Return whether another test runs a command, or its module of benchmarks or examples."""
    module = re.match(r"python -m (benchmarks|examples|docs)\.(\w+)", command)
    if module:
        folder, name = module.groups()
        imported = re.compile(rf"{folder}\.{name}\b|from {folder} import .*\b{name}\b|\"{name}\"")
        tests = (path.read_text() for path in (REPOSITORY / "tests").rglob("test_*.py"))
        return any(imported.search(text) for text in tests if folder in text)
    places = [place for pattern, place in ELSEWHERE.items() if re.fullmatch(pattern, command)]
    return any((REPOSITORY / place).exists() for place in places)
