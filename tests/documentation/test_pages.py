"""Every block of the documentation does what it says, in the order of its page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from commands import run
from pages import PAGES, REPOSITORY, Block, blocks, name

from gpvo import Configuration
from gpvo.recordings import read_kalibr
from gpvo.simulation import SimulationConfig

FIRST_STEPS = REPOSITORY / "docs" / "first_steps.md"
WITH_BLOCKS = [page for page in PAGES if blocks(page)]


@pytest.mark.parametrize("page", [page for page in WITH_BLOCKS if page != FIRST_STEPS], ids=name)
def test_blocks_of_a_page(page: Path, room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_blocks(page, monkeypatch)


def test_first_steps_write_the_files_that_they_name(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_blocks(FIRST_STEPS, monkeypatch)
    rows = re.findall(r"^\| (`[a-z].*?`) \| ", FIRST_STEPS.read_text(), re.M)
    files = {file.strip("`") for row in rows for file in row.split(", ")}
    assert len(files) > 6
    assert files <= {path.name for path in (room / "results" / "room").iterdir()}
    written = room / "results" / "room" / "trajectory.tum"
    assert (room / "trajectory.tum").read_bytes() == written.read_bytes()  # by Python, too


def run_blocks(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the blocks of a page in their order."""
    names: dict[str, Any] = {"__name__": "page"}
    for block in blocks(page):
        if block.language == "python":
            lines_before = "\n" * block.line  # so that a failure shows its line
            exec(compile(lines_before + block.text, page, "exec"), names)
        elif block.language == "sh":
            for command in block.commands:
                run(command, monkeypatch)
        else:
            assert block.language == "yaml", f"{block.language} is not run: {block.text}"
            check_yaml(block)


def check_yaml(block: Block) -> None:
    """Read a configuration, a calibration, or a simulation, of which a file is then made."""
    content = yaml.safe_load(block.text)
    if "cam0" in content:
        Path("shown.yaml").write_text(block.text)
        assert read_kalibr("shown.yaml").baseline > 0
    elif block.text.startswith("# camera.yaml"):
        SimulationConfig.model_validate(content)
        Path("camera.yaml").write_text(block.text)
    else:
        Configuration.model_validate(content)


def test_pages_that_matter_have_blocks() -> None:
    found = {name(page) for page in WITH_BLOCKS}
    assert {"README.md", "CONTRIBUTING.md", "docs/first_steps.md", "docs/smoother.md"} <= found
    assert all(page.is_relative_to(REPOSITORY) for page in PAGES)
