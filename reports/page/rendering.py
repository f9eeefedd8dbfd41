"""HTML pages that need no other files: templates, embedded pictures, and a content security policy
that allows nothing else."""

import base64
import hashlib
import io
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import matplotlib
from markupsafe import Markup
from PIL import Image as Pixels

from handbench.reports.figures.style import COLUMN, PAGE, Picture
from handbench.support.files import atomic_path, write_text

TEMPLATES = Path(__file__).parent / "templates"
WIDTH_PX = 1900  # of a picture inside a page at most; the files have full resolution
QUALITY = 82  # of WebP
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
    kinds: tuple[str, ...] = ("pdf", "png")


def begin(out: Path) -> None:
    """Write a placeholder index.html into a folder that has none. It marks the folder as that of a
    report, so that an interrupted report can be overwritten."""
    if not (out / "index.html").exists():
        write_text(out / "index.html", "<p>This report is not finished: make it again.\n")


def images(draw: Callable[[], Iterable[Picture]], folder: Path, paper: bool = True) -> list[Image]:
    """Write pictures into `folder`, and return them as images to embed in a page.
    The files are STEM.png in high resolution, and STEM.pdf, drawn again for one column of a paper.
    Each figure is released before the next is drawn.

    draw: function that makes the pictures. paper: False writes only STEM.png, as wide as in the
    page, and removes the STEM.pdf of an earlier report.
    """
    written = []
    with matplotlib.rc_context(PAGE):
        for picture in draw():
            with atomic_path(folder / f"{picture.stem}.png") as temporary:
                fine = matplotlib.rcParams["savefig.dpi"]
                dpi = fine if paper else min(fine, WIDTH_PX / picture.figure.get_figwidth())
                picture.figure.savefig(temporary, dpi=dpi)
                pixels, shown = Pixels.open(temporary), SHOWN * fine / dpi
                found = image(pixels, picture.alt, picture.caption, picture.stem, shown)
                written.append(found if paper else replace(found, kinds=("png",)))
            if not paper:  # a PDF of an earlier report of another result
                (folder / f"{picture.stem}.pdf").unlink(missing_ok=True)
    if not paper:
        return written
    with matplotlib.rc_context(COLUMN):
        for picture in draw():
            with atomic_path(folder / f"{picture.stem}.pdf") as temporary:
                # Without a date the same data give the same bytes.
                picture.figure.savefig(temporary, metadata={"CreationDate": None})
    return written


def image(
    picture: Pixels.Image, alt: str, caption: str = "", stem: str = "", shown: float = 1.0
) -> Image:
    """Return a picture ready to be embedded in a page.
    alt: text for screen readers; caption, stem: text below the picture, and name of the file in
    full resolution; shown: CSS pixels for one pixel of the picture."""
    width = round(shown * picture.width)
    return Image(
        _uri(picture), width, round(width * picture.height / picture.width), alt, caption, stem
    )


def film_image(content: bytes, alt: str, caption: str, file: Path) -> Image:
    """Write a film, the bytes of a GIF, to a file, and return it ready to be embedded in a page."""
    with atomic_path(file) as temporary:
        temporary.write_bytes(content)
    with Pixels.open(io.BytesIO(content)) as first:
        size = first.size
    uri = "data:image/gif;base64," + base64.b64encode(content).decode("ascii")
    return Image(uri, *size, alt, caption, file.stem, ("gif",))


def _uri(picture: Pixels.Image) -> str:
    """Return a picture as a data: URI (WebP), reduced to a width of 1900 pixels (WIDTH_PX) if it is
    wider."""
    small = picture.convert("RGBA" if picture.has_transparency_data else "RGB")
    if small.width > WIDTH_PX:
        small = small.resize(
            (WIDTH_PX, round(small.height * WIDTH_PX / small.width)), Pixels.Resampling.LANCZOS
        )
    stream = io.BytesIO()
    small.save(stream, "WEBP", quality=QUALITY, method=2)
    return "data:image/webp;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


def render(template: str, **facts: Any) -> str:
    """Return an HTML page made from a template of this package and the values `facts`.
    Texts are escaped. The page's security policy allows only this package's style and script,
    identified by their hashes."""
    return _environment().get_template(template).render(**facts)


@cache
def _environment() -> jinja2.Environment:
    """Return the jinja2 environment of the page templates, in which the page's style and script and
    their hashes are defined."""
    loader, strict = jinja2.FileSystemLoader(TEMPLATES), jinja2.StrictUndefined
    made = jinja2.Environment(
        loader=loader, autoescape=True, undefined=strict, trim_blocks=True, lstrip_blocks=True
    )
    for part, name in (("style", "style.css"), ("script", "viewer.js")):
        text = (TEMPLATES / name).read_text(encoding="utf-8")
        digest = base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
        made.globals |= {part: Markup(text), f"{part}_hash": f"sha256-{digest}"}
    return made
