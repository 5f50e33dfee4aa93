"""Pages of the documentation, and their blocks of code."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

REPOSITORY = Path(__file__).resolve().parents[2]
PAGES = [
    REPOSITORY / "README.md",
    REPOSITORY / "CONTRIBUTING.md",
    REPOSITORY / "factors" / "README.md",
    *sorted((REPOSITORY / "docs").rglob("*.md")),
]


class Block(NamedTuple):
    """A fenced block of a page, and the number of lines before its text."""

    language: str
    text: str
    line: int

    @property
    def commands(self) -> list[str]:
        """Commands of a block for the shell, without comments."""
        lines = (line.partition(" #")[0].strip() for line in self.text.splitlines())
        return [part.strip() for line in lines for part in line.split("&&") if part.strip()]


def name(page: Path) -> str:
    """Return a page's path in the repository."""
    return page.relative_to(REPOSITORY).as_posix()


def blocks(page: Path) -> list[Block]:
    """Return the fenced blocks of a page in their order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(found[1], found[2], text.count("\n", 0, found.start(2)))
        for found in re.finditer(r"^```(\w*)\n(.*?)^```$", text, re.M | re.S)
    ]
