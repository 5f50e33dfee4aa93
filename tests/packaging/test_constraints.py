"""The constraints pin what is needed, and agree with the lower bounds of the project."""

from __future__ import annotations

from installed import REPOSITORY, needed, project
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version


def pinned(name: str) -> dict[str, Version]:
    """Return the versions that a file of constraints asks for."""
    lines = (REPOSITORY / "constraints" / name).read_text().splitlines()
    pairs = [line.split("==") for line in lines if not line.startswith("#")]
    return {canonicalize_name(package): Version(version) for package, version in pairs}


def test_all_that_is_needed_has_a_tested_version() -> None:
    missing = {canonicalize_name(name) for name in needed()} - set(pinned("tested.txt"))
    assert not missing


def test_lower_bounds_are_the_oldest_that_were_tested() -> None:
    oldest, tested = pinned("oldest.txt"), pinned("tested.txt")
    requirements = [Requirement(text) for text in project()["dependencies"]]
    assert {canonicalize_name(one.name) for one in requirements} == set(oldest)
    for one in requirements:
        name = canonicalize_name(one.name)
        (bound,) = one.specifier
        assert bound.operator == ">="
        assert oldest[name] in SpecifierSet(f"=={bound.version}.*"), name
        assert tested[name] in one.specifier, name


def test_factors_alone_has_the_same_bounds() -> None:
    alone = project(REPOSITORY / "factors" / "pyproject.toml")["dependencies"]
    assert set(alone) <= set(project()["dependencies"])
