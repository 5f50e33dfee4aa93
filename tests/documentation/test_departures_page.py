"""docs/departures.md says how to undo each departure from the paper: by the paper's values."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from benchmarks.departures import DEPARTURES, differing, leaves, paper_values
from gpvo.config import Configuration

PAGE = (Path(__file__).resolve().parents[2] / "docs/departures.md").read_text("utf-8")


def undone() -> Iterator[dict[str, Any]]:
    """Yield the configurations in sentences that begin with "Undo" or "undo by"."""
    for sentence in re.findall(r"[Uu]ndo(?:\s+by)?[:\s](.*?)(?:\.\s|\n\n|\Z)", PAGE, re.DOTALL):
        for code in re.findall(r"`([a-z_]+: \{.*?)`", sentence, re.DOTALL):
            yield yaml.safe_load(code)


def test_the_paper_has_the_values_that_undo() -> None:
    found = dict(pair for each in undone() for pair in leaves(each))
    assert len(found) > 30
    assert found == dict(leaves(paper_values(list(found))))


def test_every_departure_can_be_undone_by_the_page() -> None:
    found = {name for each in undone() for name, _ in leaves(each)}
    assert found >= set(differing()) - {"estimator.loss_scale"}, "a scale of no loss has no effect"


def test_what_undoes_is_a_configuration() -> None:
    assert all(Configuration.model_validate(each) for each in undone())


def test_the_table_has_all_departures_with_a_link_to_what_is_said_of_each() -> None:
    rows = dict(re.findall(r"^\| \[(.*?)\]\(#(.*?)\) \|", PAGE, re.MULTILINE))
    headings = {title.lower().replace(" ", "-") for title in re.findall(r"^### (.*)$", PAGE, re.M)}
    assert set(rows) == set(DEPARTURES) and set(rows.values()) <= headings
