"""`gpvo config`: print a preset's configuration."""

from __future__ import annotations

from typing import Annotated

import typer

from gpvo.config import PRESETS, Configuration, configuration_text


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
