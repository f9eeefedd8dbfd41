"""HTML pages that need no other files: templates, embedded pictures, and a content security policy
that allows nothing else."""

import base64
import hashlib
import io
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup
from PIL import Image as Pixels

from handbench.reports.figures.style import COLUMN, PAGE, Picture, save, styled
from handbench.reports.tables import writers

TEMPLATES = Path(__file__).parent / "templates"
WIDTH_PX = 1900  # of a picture inside a page at most; the files have full resolution
QUALITY = 82  # of WebP
CONTROLS = re.compile(r"[^\n\t -~\xa0-\U0010ffff]")  # which HTML has not and terminals obey
SHOWN = 0.42  # CSS pixels for one of the file's: text as large as the page's small print


@dataclass(frozen=True)
class Image:
    """A picture embedded in a page.
    uri: its bytes as a data: URI; width, height: CSS pixels; alt: text for screen readers; caption:
    text below it; stem, kinds: name and suffixes of the files with the picture in full
    resolution."""

    uri: str
    width: int
    height: int
    alt: str
    caption: str = ""
    stem: str = ""
    kinds: tuple[str, ...] = ()


def images(draw: Callable[[], Iterable[Picture]], folder: Path, paper: bool = True) -> list[Image]:
    """Write pictures into `folder`, and return them as images to embed in a page.
    The files are STEM.png in high resolution and, if `paper`, STEM.pdf, drawn again for one column
    of a paper. Each figure is released before the next is drawn.

    draw: function that makes the pictures.
    """
    written = []
    with styled(PAGE):
        for picture in draw():
            save(picture.figure, file := folder / f"{picture.stem}.png", PAGE)
            embedded = image(Pixels.open(file), picture.alt, picture.caption, SHOWN)
            kinds = ("pdf", "png") if paper else ("png",)
            written.append(replace(embedded, stem=picture.stem, kinds=kinds))
    with styled(COLUMN):
        for picture in draw() if paper else ():
            save(picture.figure, folder / f"{picture.stem}.pdf", COLUMN)
    return written


def image(picture: Pixels.Image, alt: str, caption: str = "", shown: float = 1.0) -> Image:
    """Return a picture ready to be embedded in a page, as WebP of at most 1900 pixels (WIDTH_PX).
    alt: text for screen readers; caption: text below the picture; shown: CSS pixels for one pixel
    of the picture."""
    small = picture.convert("RGBA" if picture.has_transparency_data else "RGB")
    small.thumbnail((WIDTH_PX, picture.height), Pixels.Resampling.LANCZOS)
    stream = io.BytesIO()
    small.save(stream, "WEBP", quality=QUALITY, method=2)
    width = round(shown * picture.width)
    height = round(width * picture.height / picture.width)
    return Image(_uri("webp", stream.getvalue()), width, height, alt, caption)


def film_image(content: bytes, text: str, file: Path) -> Image:
    """Write a film, the bytes of a GIF, to a file of an existing folder, and return it ready to be
    embedded in a page. text: its caption, also for screen readers."""
    file.write_bytes(content)
    width, height = Pixels.open(io.BytesIO(content)).size
    return Image(_uri("gif", content), width, height, text, text, file.stem, ("gif",))


def _uri(kind: str, content: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def render(template: str, **facts: Any) -> str:
    """Return an HTML page made from a template of this package and the values `facts`.
    Texts are escaped, and their control characters replaced. The page's security policy allows only
    this package's style and script, identified by their hashes."""
    return CONTROLS.sub("\ufffd", _environment().get_template(template).render(**facts))


@cache
def _environment() -> jinja2.Environment:
    """Return the jinja2 environment of the page templates, in which the page's style and script and
    their hashes are defined."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["table"] = writers.html
    for part, name in (("style", "style.css"), ("script", "viewer.js")):
        text = (TEMPLATES / name).read_bytes()
        digest = base64.b64encode(hashlib.sha256(text).digest()).decode("ascii")
        environment.globals |= {part: Markup(text.decode()), f"{part}_hash": f"sha256-{digest}"}
    return environment
