"""Opening commands of the README, and names and links in all pages."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml
from commands import is_run_elsewhere, run
from pages import PAGES, REPOSITORY, blocks, name

from docs.make_pictures import EXAMPLES, PICTURES, RESULTS
from gpvo import Configuration
from gpvo.commands.cli import COMMANDS

README = REPOSITORY / "README.md"
FOLDERS = "gpvo|factors|tests|examples|benchmarks|docs|constraints"
PICTURE = r"!\[[^]]+\]\(([^)]+\.png)\)"
TEXTS = {page: page.read_text(encoding="utf-8") for page in PAGES}


def test_first_command_ends_in_the_demo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first = next(block for block in blocks(README) if block.language == "sh")
    assert first.text.strip().endswith("gpvo demo")
    monkeypatch.chdir(tmp_path)
    run("gpvo demo", monkeypatch)
    assert (tmp_path / "results" / "latest" / "path.png").exists()
    assert "final %" in capsys.readouterr().out


def test_second_command_passes_the_tests() -> None:
    lines = [line for line in TEXTS[README].splitlines() if line.startswith("python3 -m venv")]
    assert len([line for line in lines if "-m pytest" in line]) == 1


def test_the_readme_is_one_screen() -> None:
    assert len(TEXTS[README].splitlines()) <= 90


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_fields_and_files_that_a_page_names_exist(page: Path) -> None:
    for text in re.findall(r"`((?:[a-z_]+\.)*[a-z_]+: [^`]+)`", TEXTS[page]):
        Configuration.model_validate(nested(text))
    for file in re.findall(rf"`((?:{FOLDERS})/[^` ]*)`", TEXTS[page]):
        assert (REPOSITORY / file).exists(), file
    for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", TEXTS[page]):
        assert (page.parent / link).exists(), link


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_in_the_text_of_a_page_exist(page: Path) -> None:
    text = re.sub(r"^```.*?^```$", "", TEXTS[page], flags=re.M | re.S)
    for command in re.findall(r"`((?:python -m|pip install|gpvo) [^`A-Z]+)`", text):
        program, _, rest = command.partition(" ")
        if program == "gpvo":
            assert rest.startswith("--") or rest.split()[0] in COMMANDS, command
        else:
            assert is_run_elsewhere(command), command


def nested(text: str) -> dict:
    """Return fields such as `stage.field: value` as the configuration file has them."""
    *path, leaf = text.partition(":")[0].split(".")
    content = {leaf: yaml.safe_load(text.partition(":")[2])}
    for stage in reversed(path):
        content = {stage: content}
    return content


def test_pictures_are_made_by_the_script_and_are_shown() -> None:
    made = {*EXAMPLES, "consistency", *(f"demo_{each}" for each in RESULTS)}
    assert made == {path.stem for path in PICTURES.glob("*.png")}
    shown = {Path(found).stem for text in TEXTS.values() for found in re.findall(PICTURE, text)}
    assert shown == made


def test_fields_that_pages_name_by_their_stage_exist() -> None:
    stages = "|".join(Configuration.model_fields)
    for page, text in TEXTS.items():
        for field in re.findall(rf"`((?:{stages})\.(?!png)[a-z_.]+)`", text):
            found: object = Configuration()
            for part in field.split("."):
                assert hasattr(found, part), f"{name(page)}: {field}"
                found = getattr(found, part)
