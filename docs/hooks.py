"""What MkDocs fills into pages: other Markdown files, and the tables of the configuration.

A line `{{ include PATH }}` becomes the Markdown file, `{{ configuration }}` a table of all fields.
Formulas become MathML, which browsers show without a network.
"""

from __future__ import annotations

import re
from html import unescape
from importlib import import_module
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

from gpvo.config.tables import configuration_tables

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\(\(|\[)(.*?)\\[)\]]</\1>', re.DOTALL)
"""A formula as Markdown leaves it, in its line or between lines."""
REPOSITORY = Path(__file__).resolve().parents[1]
PACKAGES = (
    "gpvo",
    "gpvo.config",
    "gpvo.estimator",
    "gpvo.evaluation",
    "gpvo.events",
    "gpvo.faults",
    "gpvo.live",
    "gpvo.mapping",
    "gpvo.mc_ransac",
    "gpvo.recordings",
    "gpvo.simulation",
    "gpvo.tracking",
    "gpvo.trajectory",
    "factors",
)
"""Packages of which all exported names are in the API reference."""


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill in what a page asks for; called by MkDocs."""
    markdown = markdown.replace("{{ configuration }}", configuration_tables())
    return re.sub(r"\{\{ include (\S+) \}\}", _included, markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Turn the formulas of a page into MathML; called by MkDocs."""
    return FORMULA.sub(_mathml, html)


def _mathml(found: re.Match[str]) -> str:
    kind = "block" if found[2] == "[" else "inline"
    return f"<{found[1]}>{convert(unescape(found[3]).strip(), display=kind)}</{found[1]}>"


def _included(found: re.Match[str]) -> str:
    """Return a Markdown file of the repository, with links as they are from the page."""
    path = REPOSITORY / found[1]
    text = path.read_text(encoding="utf-8")
    return re.sub(r"\]\((?:\.\./)?docs/", "](", text)


def on_post_build(config: Any) -> None:
    """Stop if a public name is missing in the API reference; called by MkDocs."""
    pages = Path(config["site_dir"], "api").rglob("*.html")
    html = "".join(page.read_text(encoding="utf-8") for page in pages)
    documented = set(re.findall(r'id="([\w.]+)"', html))
    public = [(name, each) for name in PACKAGES for each in import_module(name).__all__]
    if missing := [f"{name}.{each}" for name, each in public if not _ids(name, each) & documented]:
        raise PluginError(f"missing in the API reference: {', '.join(missing)}")


def _ids(package: str, name: str) -> set[str]:
    """Return where a name may be documented: where it is exported, or where it is made."""
    made = getattr(getattr(import_module(package), name), "__module__", package)
    return {f"{package}.{name}", f"{made}.{name}"}
