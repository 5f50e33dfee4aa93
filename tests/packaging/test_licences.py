"""The licence is stated where tools look for it, and nothing that gpvo needs is under the GPL."""

from __future__ import annotations

import re
from importlib.metadata import Distribution

import pytest
from installed import REPOSITORY, needed, project

GPL = re.compile(r"(?<!L)GPL|(?<!Lesser )General Public License", re.IGNORECASE)


def licence(of: Distribution) -> str:
    """Return what a distribution says first of its licence: name, classifier, or file."""
    fields = of.metadata
    classifiers = [one for one in fields.get_all("Classifier", ()) if one.startswith("License")]
    stated = [fields.get("License-Expression"), *classifiers, fields.get("License")]
    files = [file for file in of.files or () if file.name.upper().startswith("LICENSE")]
    texts = [str(one) for one in stated if one] or [file.read_text() for file in files[:1]]
    return " ".join(texts)[:200]


def test_nothing_that_is_needed_is_under_the_gpl() -> None:
    found = {name: licence(one) for name, one in needed().items()}
    assert {"gtsam", "numpy", "opencv-python-headless"} < set(found)
    assert all(found.values()), found
    assert not [name for name, text in found.items() if GPL.search(text)]


@pytest.mark.parametrize(
    ("text", "is_gpl"),
    [
        ("GPL-3.0-or-later", True),
        ("License :: OSI Approved :: GNU General Public License v3 (GPLv3)", True),
        ("AGPL-3.0", True),
        ("LGPL-2.1-or-later", False),
        ("BSD-3-Clause", False),
    ],
)
def test_a_gpl_would_be_seen(text: str, is_gpl: bool) -> None:
    assert bool(GPL.search(text)) == is_gpl


@pytest.mark.parametrize("folder", [".", "factors"])
def test_the_licence_is_in_the_metadata(folder: str) -> None:
    """Both packages, which can be installed alone, carry the same text."""
    place = REPOSITORY / folder
    fields = project(place / "pyproject.toml")
    assert fields["license"] == "BSD-3-Clause"
    assert fields["authors"] == [{"name": "gpvo developers"}]
    assert fields["keywords"] and fields["classifiers"]
    text = (place / fields["license-files"][0]).read_text()
    assert text == (REPOSITORY / "LICENSE").read_text()
    assert text.startswith("BSD 3-Clause License\n\nCopyright (c) 2026, gpvo developers\n")
