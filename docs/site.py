"""Hooks of MkDocs for the documentation's site (docs/mkdocs.yml): files outside docs/ become pages
of the site, and the navigation is read from docs/README.md.

README.md becomes the front page and docs/README.md the page of contents. CONTRIBUTING.md,
CHANGELOG.md and the notebooks of examples/ are pages too. A link to any other file outside docs/,
for instance to code, is replaced by its text, because the site has no page for it.
"""

from __future__ import annotations

import base64
import html
import io
import json
import posixpath
import re
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import math_to_image
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
FENCE = re.compile(r"^(```.*?^```)", re.DOTALL | re.MULTILINE)
MATH = re.compile(r"(`[^`]*`)|\$([^$\n]+)\$")
SPELT = {  # LaTeX that matplotlib does not know: the same as it does
    r"\\mathbf (\w)": r"\\mathbf{\1}",
    r"\\[td]?frac\s*(\w)\s*(\w)": r"\\frac{\1}{\2}",
    r"\\[td]frac": r"\\frac",
    r"\\(g|l)e\b": r"\\\1eq",
    r"\\[lr]vert\b": "|",
}
OUTSIDE = {  # file of the repository: page of the site
    "README.md": "index.md",
    "docs/README.md": "contents.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}


def notebooks() -> list[str]:
    """Return the paths of the repository's notebooks, relative to its root."""
    return sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("examples/*.ipynb"))


def pages() -> dict[str, str]:
    """List the files outside docs/ that become pages of the site: path in the repository → name of
    the page."""
    return OUTSIDE | {name: Path(name).with_suffix(".md").as_posix() for name in notebooks()}


def slug(heading: str, separator: str = "-") -> str:
    """Return the anchor of a heading as GitHub makes it, because links in the pages use it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", separator)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Set anchors like GitHub's and the navigation in MkDocs' configuration, and return it."""
    config.mdx_configs["toc"] = {"slugify": slug, "permalink": True}
    config.nav = navigation((ROOT / "docs/README.md").read_text("utf-8"))
    return config


def navigation(contents: str) -> list[Any]:
    """Return the site's navigation: the groups of the page of contents (its lines in bold), each
    with the pages to which it links. Measurements form a separate group.
    contents: text of docs/README.md. A page to which no group links is left out; a test of the
    index reports it."""
    groups: dict[str, list[str]] = {"Start": ["index.md", "contents.md"]}
    for heading, text in re.findall(
        r"^\*\*([^*]+)\*\*$(.*?)(?=^\*\*|\Z)", contents, re.DOTALL | re.MULTILINE
    ):
        for _, _, target in LINK.findall(text):
            page = moved(target, "docs/README.md").partition("#")[0]
            group = "Measurements" if page.startswith("measurements/") else heading
            if page.endswith(".md") and page not in [
                name for names in groups.values() for name in names
            ]:
                groups.setdefault(group, []).append(page)
    groups["Inside"] = [*groups.get("Inside", []), "changelog.md"]
    order = sorted(groups, key=lambda group: group in ("Measurements", "Inside"))
    return [{group: groups[group]} for group in order]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages made from files outside docs/ to the site's files, and return these."""
    for name, page in pages().items():
        text = (ROOT / name).read_text("utf-8")
        files.append(
            File.generated(config, page, content=cells(text) if name.endswith(".ipynb") else text)
        )
    return files


def cells(notebook: str) -> str:
    """Return the text and the code of a notebook (JSON) as Markdown."""
    found = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(notebook)["cells"]]
    return "\n\n".join(
        text if kind == "markdown" else f"```python\n{text}\n```" for kind, text in found
    )


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Return a page's Markdown with links that lead to pages of the site, and with formulas as
    pictures. Blocks of code are unchanged."""
    inside = {place: name for name, place in pages().items()}
    source = inside.get(page.file.src_uri, f"docs/{page.file.src_uri}")

    def link(found: re.Match[str]) -> str:
        image, text, target = found.groups()
        if "://" in target or target.startswith("#"):
            return found[0]
        place = moved(target, source)
        if place.startswith("../"):
            return text
        start = posixpath.dirname(page.file.src_uri) or "."
        return f"{image}[{text}]({posixpath.relpath(place, start)})"

    parts = FENCE.split(markdown)
    return "".join(
        fenced(part) if i % 2 else formulas(LINK.sub(link, part)) for i, part in enumerate(parts)
    )


def fenced(block: str) -> str:
    """Return a fenced block of Markdown: a block of mathematics becomes a picture, any other stays
    unchanged."""
    return f"<p>{formula(block[7:-3])}</p>" if block.startswith("```math") else block


def formulas(text: str) -> str:
    """Return Markdown in which every formula $…$ is replaced by a picture. Inline code is
    unchanged."""
    return MATH.sub(lambda found: found[1] or formula(found[2]), text)


def formula(latex: str) -> str:
    """Return a LaTeX formula as an HTML image with embedded SVG, aligned with the line of text."""
    spelt = " ".join(latex.split())
    for unknown, known in SPELT.items():
        spelt = re.sub(unknown, known, spelt)
    drawn = io.BytesIO()
    with matplotlib.rc_context(
        {"svg.hashsalt": "handbench", "mathtext.fontset": "cm", "figure.facecolor": "none"}
    ):
        depth = math_to_image(
            f"${spelt}$", drawn, prop=FontProperties(size=12), format="svg", dpi=72
        )
    source = base64.b64encode(drawn.getvalue()).decode("ascii")
    alt = (
        html.escape(" ".join(latex.split()))
        .replace("|", "&#124;")
        .replace("_", "&#95;")
        .replace("*", "&#42;")
    )
    style = f"vertical-align:{-depth:.1f}pt"
    return (
        f'<img class="math" style="{style}" alt="{alt}" src="data:image/svg+xml;base64,{source}">'
    )


def moved(target: str, source: str) -> str:
    """Return the path in the site of a file to which a link in `source` leads. For a file without a
    page, the path begins with "../".
    target: the link, relative to `source`; source: a file of the repository."""
    name, mark, anchor = target.partition("#")
    there = posixpath.normpath(posixpath.join(posixpath.dirname(source), name)) if name else source
    return pages().get(there, posixpath.relpath(there, "docs")) + mark + anchor
