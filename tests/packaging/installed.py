"""What is installed: the distributions that the default installation of gpvo needs."""

from __future__ import annotations

from importlib.metadata import Distribution, distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

REPOSITORY = Path(__file__).resolve().parents[2]


def project(path: Path = REPOSITORY / "pyproject.toml") -> dict[str, Any]:
    """Return the table [project] of a pyproject.toml."""
    import tomllib

    return tomllib.loads(path.read_text())["project"]


def needed() -> dict[str, Distribution]:
    """Return the distributions that gpvo needs without extras, and those that they need."""
    found: dict[str, Distribution] = {}
    waiting = [Requirement(text) for text in project()["dependencies"]]
    while waiting:
        name = waiting.pop().name.lower()
        if name in found:
            continue
        found[name] = distribution(name)
        all_of = map(Requirement, found[name].requires or ())
        waiting += [one for one in all_of if not one.marker or one.marker.evaluate({"extra": ""})]
    return found
