"""A result table for the terminal, Markdown, LaTeX and HTML."""

from __future__ import annotations

import re
from dataclasses import dataclass
from html import escape as escape_html

from rich.console import Console, JustifyMethod
from rich.table import Table
from rich.text import Text

LATEX_PACKAGES = r"\usepackage{amsmath, booktabs}"

NARROWEST = 14
"""Width that columns of the terminal keep, if they have it: any number fits."""
LATEX_SPECIAL = {
    "\\": r"\textbackslash{}",
    "%": r"\%",
    "&": r"\&",
    "#": r"\#",
    "$": r"\$",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "°": r"$^\circ$",
    "–": "--",
}


@dataclass(frozen=True)
class Cell:
    """Entry of a table, in bold if it is the best of its kind."""

    text: str
    best: bool = False


@dataclass(frozen=True)
class ResultTable:
    """Headings and rows; lines are drawn after every `group` rows."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    group: int = 1


def to_rich(table: ResultTable) -> Table:
    """Format a table for the terminal, with names as they are, also with brackets.

    Long names are wrapped, numbers never: a table of many columns may be wider than the terminal.
    """
    rich = Table(title=Text(table.title, "table.title"), title_justify="left")
    for index, heading in enumerate(table.headings):
        justify: JustifyMethod = "left" if index == 0 else "right"
        longest = max((len(row[index].text) for row in table.rows), default=0)
        least = min(longest, NARROWEST)
        rich.add_column(Text(heading), justify=justify, overflow="fold", min_width=least)
    for number, row in enumerate(table.rows, start=1):
        rich.add_row(*map(_rich_cell, row), end_section=number % table.group == 0)
    return rich


def print_table(console: Console, table: ResultTable) -> None:
    """Print a table whole, even if it is wider than the terminal."""
    console.print(to_rich(table), crop=False)


def _rich_cell(cell: Cell) -> Text:
    return Text(cell.text, "bold" if cell.best else "")


def to_markdown(table: ResultTable) -> str:
    """Format a table in Markdown, with the title as a heading."""
    lines = [_markdown_row(table.headings), _markdown_row(["---"] * len(table.headings))]
    lines += [_markdown_row([_markdown_cell(cell) for cell in row]) for row in table.rows]
    return f"### {table.title}\n\n" + "\n".join(lines) + "\n"


def _markdown_row(texts: list[str] | tuple[str, ...]) -> str:
    return "| " + " | ".join(texts) + " |"


def _markdown_cell(cell: Cell) -> str:
    text = cell.text.replace("|", r"\|")
    return f"**{text}**" if cell.best else text


def to_latex(table: ResultTable) -> str:
    """Format a table for a LaTeX document with LATEX_PACKAGES."""
    lines = [
        r"\begin{table}[tbp]",
        r"\centering",
        rf"\caption{{{_latex_text(table.title)}}}",
        rf"\begin{{tabular}}{{l{'r' * (len(table.headings) - 1)}}}",
        r"\toprule",
        _latex_row([_latex_text(heading) for heading in table.headings]),
        r"\midrule",
    ]
    for number, row in enumerate(table.rows, start=1):
        lines.append(_latex_row([_latex_cell(cell) for cell in row]))
        if number % table.group == 0 and number < len(table.rows):
            lines.append(r"\midrule")
    lines += [r"\bottomrule", r"\end{tabular}", r"\end{table}"]
    return "\n".join(lines) + "\n"


def _latex_row(texts: list[str]) -> str:
    return " & ".join(texts) + r" \\"


def _latex_cell(cell: Cell) -> str:
    scientific = re.fullmatch(r"(\d+\.\d+)e-3", cell.text)
    if scientific:
        number = rf"{scientific[1]} \cdot 10^{{-3}}"
        return rf"$\boldsymbol{{{number}}}$" if cell.best else f"${number}$"
    text = _latex_text(cell.text)
    return rf"\textbf{{{text}}}" if cell.best else text


def _latex_text(text: str) -> str:
    return "".join(LATEX_SPECIAL.get(character, character) for character in text)


def to_html(table: ResultTable) -> str:
    """Format a table as an HTML element with a caption."""
    head = "".join(f"<th>{escape_html(heading)}</th>" for heading in table.headings)
    body = []
    for number, row in enumerate(table.rows, start=1):
        style = ' class="last"' if number % table.group == 0 else ""
        body.append(f"<tr{style}>" + "".join(map(_html_cell, row)) + "</tr>")
    caption = f"<caption>{escape_html(table.title)}</caption>"
    rows = "\n".join(body)
    return f"<table>{caption}\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody></table>"


def _html_cell(cell: Cell) -> str:
    text = escape_html(cell.text)
    return f"<td><b>{text}</b></td>" if cell.best else f"<td>{text}</td>"
