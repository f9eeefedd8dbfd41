"""Hooks of MkDocs for the documentation's site (docs/mkdocs.yml).

README.md becomes the front page, docs/README.md the page of contents; CONTRIBUTING.md and
CHANGELOG.md are pages too. A link to any other file outside docs/, for instance to code, is
replaced by its text, because the site has no page for it. Formulas become pictures, and the line
`<!-- metrics -->` becomes the table of all metrics.
"""

from __future__ import annotations

import base64
import html
import io
import posixpath
import re
from pathlib import Path

import matplotlib
import pandas as pd
from matplotlib.mathtext import math_to_image
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from handbench.bench.evaluation.metrics import METRICS
from handbench.reports.tables.table import Table
from handbench.reports.tables.writers import markdown as written

ROOT = Path(__file__).parents[1]
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
FENCE = re.compile(r"^(```.*?^```)", re.DOTALL | re.MULTILINE)
MATH = re.compile(r"(`[^`]*`)|\$([^$\n]+)\$")
STYLE = {
    "svg.hashsalt": "handbench",
    "mathtext.fontset": "cm",
    "font.size": 12,
    "figure.facecolor": "none",
}
OUTSIDE = {  # file of the repository: page of the site
    "README.md": "index.md",
    "docs/README.md": "contents.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages made from files outside docs/ to the site's files, and return these."""
    for name, page in OUTSIDE.items():
        files.append(File.generated(config, page, content=(ROOT / name).read_text("utf-8")))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Return a page's Markdown with links that lead to pages of the site, formulas as pictures, and
    the table of metrics. Blocks of code are unchanged."""
    inside = {place: name for name, place in OUTSIDE.items()}
    source = inside.get(page.file.src_uri, f"docs/{page.file.src_uri}")

    def link(found: re.Match[str]) -> str:
        image, text, target = found.groups()
        name, mark, anchor = target.partition("#")
        if "://" in target or not name:
            return found[0]
        there = posixpath.normpath(posixpath.join(posixpath.dirname(source), name))
        place = OUTSIDE.get(there, posixpath.relpath(there, "docs"))
        if place.startswith("../"):
            return text
        start = posixpath.dirname(page.file.src_uri) or "."
        return f"{image}[{text}]({posixpath.relpath(place, start)}{mark}{anchor})"

    parts = FENCE.split(markdown.replace("<!-- metrics -->", metrics_table()))
    return "".join(
        fenced(part) if i % 2 else formulas(LINK.sub(link, part)) for i, part in enumerate(parts)
    )


def metrics_table() -> str:
    """Return the table of all metrics: key, unit, direction, definition."""
    metrics = pd.DataFrame(map(vars, METRICS.values()), pd.Index(METRICS, name="metric"))
    return written(Table("", metrics[["unit", "better", "definition"]], left=3))


def fenced(block: str) -> str:
    """Return a fenced block of Markdown: a block of mathematics becomes a picture, any other stays
    unchanged."""
    return f"<p>{formula(block[7:-3])}</p>" if block.startswith("```math") else block


def formulas(text: str) -> str:
    """Return Markdown in which every formula $…$ is replaced by a picture. Inline code is
    unchanged."""
    return MATH.sub(lambda found: found[1] or formula(found[2]), text)


def formula(latex: str) -> str:
    """Return a LaTeX formula, in what matplotlib knows of LaTeX, as an HTML image with embedded
    SVG, aligned with the line of text."""
    spelt = " ".join(latex.split())
    alt = re.sub(r"[|_*]", lambda sign: f"&#{ord(sign[0])};", html.escape(spelt))
    drawn = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        depth = math_to_image(f"${spelt}$", drawn, format="svg", dpi=72)
    source = base64.b64encode(drawn.getvalue()).decode("ascii")
    return (
        f'<img class="math" style="vertical-align:{-depth:.1f}pt" alt="{alt}" '
        f'src="data:image/svg+xml;base64,{source}">'
    )
