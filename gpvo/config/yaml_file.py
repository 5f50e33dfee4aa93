"""The configuration as a YAML file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import ValidationError

from gpvo.config.stages import Configuration, StageConfig
from gpvo.errors import InputError

Fields = TypeVar("Fields", bound=StageConfig)


def load_configuration(path: Path | str) -> Configuration:
    """Read a YAML file with some or all of the fields that `gpvo config` prints.

    Raises
    ------
    InputError
        If the file cannot be read, or a field is unknown or has a bad value; the message names it.
    """
    return load_fields(path, Configuration, "`gpvo config` prints all fields and their defaults")


def load_fields(path: Path | str, model: type[Fields], advice: str) -> Fields:
    """Read a YAML file with some of a model's fields; error messages end with `advice`.

    Raises
    ------
    InputError
        If the file cannot be read, or a field is unknown or has a bad value; the message names it.
    """
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: is not a readable YAML file ({reason})") from error
    try:
        return model.model_validate({} if content is None else content)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(map(str, first["loc"])) or "the file"
        raise InputError(f"{path}: {field}: {first['msg']}; {advice}") from error


def configuration_text(configuration: Configuration, described: bool = False) -> str:
    """Format the configuration as YAML, with a comment above each field if `described`."""
    return "".join(f"{line}\n" for line in _lines(configuration, described, ""))


def value_text(value: Any) -> str:
    """Format the value of a field as YAML, in one line."""
    plain = list(value) if isinstance(value, tuple) else value
    text = yaml.safe_dump(plain, default_flow_style=True, width=200)
    return str(text.splitlines()[0])


def _lines(stage: StageConfig, described: bool, indent: str) -> list[str]:
    lines = []
    for name, field in type(stage).model_fields.items():
        value = getattr(stage, name)
        if isinstance(value, StageConfig):
            comment = [f"{indent}# {(value.__doc__ or '').splitlines()[0]}"] if described else []
            inner = _lines(value, described, indent + "  ")
            lines += [*comment, f"{indent}{name}:", *inner]
            continue
        if described and field.description:
            lines.append(f"{indent}# {field.description}")
        lines.append(f"{indent}{name}: {value_text(value)}")
    return lines
