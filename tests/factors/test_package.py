"""`factors` needs GTSAM, NumPy and numba only, is typed, and lists what it exports."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

import factors
from factors.kernels import compiled

FOLDER = Path(factors.__file__).parent
MODULES = sorted(FOLDER.rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Top-level names of what a module imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {name.name.split(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.split(".")[0])
    return found


def test_it_imports_gtsam_numpy_and_numba_only() -> None:
    allowed = {"factors", "gtsam", "numpy", "numba"} | set(sys.stdlib_module_names)
    for path in MODULES:
        assert imported(path) <= allowed, path.name


def test_it_can_be_installed_alone() -> None:
    """Its own project lists all its folders and what it needs."""
    tomllib = pytest.importorskip("tomllib")  # from Python 3.11 on
    project = tomllib.loads((FOLDER / "pyproject.toml").read_text())
    folders = {path.parent.relative_to(FOLDER) for path in MODULES}
    names = {".".join(("factors", *folder.parts)) for folder in folders}
    assert set(project["tool"]["setuptools"]["packages"]) == names
    needed = {name.split(">")[0] for name in project["project"]["dependencies"]}
    assert needed == {"gtsam", "numpy", "numba"}
    assert (FOLDER / project["project"]["readme"]).exists()
    assert (FOLDER / "py.typed").exists()


def test_all_exported_names_exist_and_are_in_the_readme_once_a_factor() -> None:
    readme = (FOLDER / "README.md").read_text()
    for name in factors.__all__:
        found = getattr(factors, name)
        if isinstance(found, type) and issubclass(found, factors.Factor) and name != "Factor":
            assert f"`{name}`" in readme, name


def test_where_nothing_can_be_kept_the_remedy_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a container that is read-only, say, numba names the first kernel only."""

    def refuse(_: object) -> None:
        raise RuntimeError("cannot cache function 'f': no locator available for file 'f.py'")

    monkeypatch.setattr(compiled, "kernel", refuse)
    with pytest.raises(RuntimeError, match="set NUMBA_CACHE_DIR to a folder that can be written"):
        compiled.require_cache()
