"""Tables of all fields of the configuration in Markdown, for the documentation."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, get_args

import annotated_types
from pydantic.fields import FieldInfo

from gpvo.config.stages import Configuration, StageConfig
from gpvo.config.yaml_file import value_text

UNITS = (
    "tracked pixel^-2",
    "tracked pixels per root second",
    "tracked pixels per second",
    "tracked pixels",
    "pixels",
    "seconds",
    "standard deviations (norm)",
    "rad/s and m/s",
)
"""Units that descriptions name after a comma or "in"; those of Q_c differ by component."""

SYMBOLS = {
    annotated_types.Gt: ("gt", ">"),
    annotated_types.Ge: ("ge", "≥"),
    annotated_types.Lt: ("lt", "<"),
    annotated_types.Le: ("le", "≤"),
}
"""Kinds of bounds, where they hold their value, and how it is written."""


def configuration_tables() -> str:
    """Return a heading and a table for each stage: field, default, paper, unit, rule, meaning."""
    auto, paper = (Configuration.model_validate({"preset": name}) for name in ("auto", "paper"))
    return "\n".join(_stage("", auto, paper))


def unit(field: FieldInfo) -> str:
    """Return the unit that a field's description names, or nothing."""
    units = "|".join(map(re.escape, UNITS))
    found = re.search(rf"(?:,|in) ({units})(?![a-z^ ])", field.description or "")
    return found[1] if found else ""


def rule(field: FieldInfo) -> str:
    """Return the values that a field may have."""
    bounds = [_bound(one) for one in field.metadata if type(one) in SYMBOLS]
    choices = [str(one) for one in get_args(field.annotation) if isinstance(one, str)]
    return " or ".join(f"`{one}`" for one in choices) or ", ".join(bounds)


def _stage(path: str, auto: StageConfig, paper: StageConfig) -> Iterator[str]:
    """Yield the lines of a stage's table and of those inside it."""
    inner = []
    if path:
        yield f"\n## `{path}`\n\n{(type(auto).__doc__ or '').splitlines()[0]}\n"
    yield "\n| field | default | paper | unit | values | |\n|---|---|---|---|---|---|"
    for name, field in type(auto).model_fields.items():
        ours, theirs = getattr(auto, name), getattr(paper, name)
        if isinstance(ours, StageConfig):
            inner.append((f"{path}.{name}".strip("."), ours, theirs))
            continue
        other = "" if ours == theirs else f"`{value_text(theirs)}`"
        cells = [f"`{name}`", f"`{value_text(ours)}`", other, unit(field), rule(field)]
        yield f"| {' | '.join(cells)} | {re.sub(r'[|]', '/', field.description or '')} |"
    for where, ours, theirs in inner:
        yield from _stage(where, ours, theirs)


def _bound(constraint: Any) -> str:
    """Return a bound as it is written."""
    attribute, symbol = SYMBOLS[type(constraint)]
    return f"{symbol} {getattr(constraint, attribute):g}"
