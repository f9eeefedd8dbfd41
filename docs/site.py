"""Hooks of the documentation's site (docs/mkdocs.yml): what lies outside this folder becomes part
of it, and the navigation is read from docs/README.md.

README.md is the front page, docs/README.md the page of contents; CONTRIBUTING.md, CHANGELOG.md and
the notebooks of examples/ are pages, too. A link to any other file outside, to code for instance,
becomes its text: the site has no place for it.
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
    """The notebooks of the repository."""
    return sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("examples/*.ipynb"))


def pages() -> dict[str, str]:
    """Every file outside this folder that is a page, and that page."""
    return OUTSIDE | {name: Path(name).with_suffix(".md").as_posix() for name in notebooks()}


def slug(heading: str, separator: str = "-") -> str:
    """A heading's anchor as GitHub makes it, which the pages' links expect."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", separator)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Anchors as GitHub's; the navigation."""
    config.mdx_configs["toc"] = {"slugify": slug, "permalink": True}
    config.nav = navigation((ROOT / "docs/README.md").read_text("utf-8"))
    return config


def navigation(contents: str) -> list[Any]:
    """The groups of the page of contents, in bold there, with the pages that each links to;
    measurements by themselves. A page that no group names is not lost: the test of the index
    notices."""
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
    """The pages from outside."""
    for name, page in pages().items():
        text = (ROOT / name).read_text("utf-8")
        files.append(
            File.generated(config, page, content=cells(text) if name.endswith(".ipynb") else text)
        )
    return files


def cells(notebook: str) -> str:
    """A notebook as Markdown: its words and its code."""
    found = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(notebook)["cells"]]
    return "\n\n".join(
        text if kind == "markdown" else f"```python\n{text}\n```" for kind, text in found
    )


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links as they lead inside the site; outside code alone."""
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
    """A block of code as it is, one of mathematics as a picture."""
    return f"<p>{formula(block[7:-3])}</p>" if block.startswith("```math") else block


def formulas(text: str) -> str:
    """Text whose formulas are pictures."""
    return MATH.sub(lambda found: found[1] or formula(found[2]), text)


def formula(latex: str) -> str:
    """A formula as a picture in the page, which stands on the line of the text."""
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
    """The place in the site of what `source`, a file of the repository, links to; ../… for what has
    none there."""
    name, mark, anchor = target.partition("#")
    there = posixpath.normpath(posixpath.join(posixpath.dirname(source), name)) if name else source
    return pages().get(there, posixpath.relpath(there, "docs")) + mark + anchor
