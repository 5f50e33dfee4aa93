"""Tables of the configuration: every field, with unit, default and rule."""

from __future__ import annotations

import re

from gpvo.config import Configuration, StageConfig
from gpvo.config.tables import configuration_tables, rule, unit

WITHOUT_UNIT = {
    "hot_pixel_ratio",
    "response_threshold",
    "anchor_correlation",
    "min_correlation",
    "min_row_gradient",
    "relative_threshold",
    "confidence",
    "max_condition",
    "relative_decrease",
    "gate",
    "spacing",
    "crowding",
    "candidates",
    "lag_share",
    "density",
    "disparity_drift",
    "picture",
    "feature_rate",
    "velocity_share",
    "acceleration_memory",
    "acceleration_psd",
}
"""Ratios, levels of grey, numbers per pixel or second, and Q_c, whose halves have own units."""


def fields(stage: StageConfig) -> list[tuple[str, object]]:
    """Return names and fields of a stage and those inside it."""
    found: list[tuple[str, object]] = []
    for name, field in type(stage).model_fields.items():
        value = getattr(stage, name)
        found += fields(value) if isinstance(value, StageConfig) else [(name, field)]
    return found


def test_every_field_has_a_row() -> None:
    rows = re.findall(r"^\| `(\w+)` \|", configuration_tables(), re.M)
    assert sorted(rows) == sorted(name for name, _ in fields(Configuration()))


def test_every_number_that_is_no_count_or_ratio_has_a_unit() -> None:
    for name, field in fields(Configuration()):
        is_real = "float" in str(field.annotation)
        assert bool(unit(field)) == (is_real and name not in WITHOUT_UNIT) or "int" in str(
            field.annotation
        ), name


def test_rules_and_defaults_are_those_of_the_models() -> None:
    text = configuration_tables()
    assert "| `window` | `0.5` | `0.1` | seconds | ≥ 0.001 | Longest duration" in text
    assert "| `max_events` | `null` | `20000` |  | > 0 |" in text
    assert "`klt` or `viso2`" in text
    named = dict(fields(Configuration()))
    assert rule(named["confidence"]) == "> 0, ≤ 1"
    assert rule(named["seed"]) == "≥ 0"
