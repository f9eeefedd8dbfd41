"""Pages that need nothing but themselves: templates, pictures inside, and a policy that lets nothing else in."""

from __future__ import annotations

import base64
import hashlib
import io
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup
from PIL import Image as Pixels

TEMPLATES = Path(__file__).parent / "templates"
WIDTH_PX = 1900  # of a picture inside a page at most; the files beside it have every pixel
QUALITY = 82
SHOWN = 0.42  # CSS pixels for one of the file's: text as large as the page's small print


@dataclass(frozen=True)
class Image:
    """A picture inside a page: its bytes as a data: URI, its size there in CSS pixels, words, and the stem of the files
    beside it (empty: there are none)."""

    uri: str
    width: int
    height: int
    alt: str
    caption: str = ""
    stem: str = ""


def picture_file(png: Path, alt: str, caption: str, stem: str) -> Image:
    """A written picture, smaller for the page."""
    with Pixels.open(png) as picture:
        return _image(picture, round(SHOWN * picture.width), alt, caption, stem)


def picture_of(pixels: np.ndarray, alt: str) -> Image:
    """Pixels [rows, columns, 3] in 8 bits as a picture."""
    return _image(Pixels.fromarray(pixels), pixels.shape[1], alt)


def _image(picture: Pixels.Image, width: int, alt: str, caption: str = "", stem: str = "") -> Image:
    small = picture.convert("RGB")
    if small.width > WIDTH_PX:
        small = small.resize((WIDTH_PX, round(small.height * WIDTH_PX / small.width)), Pixels.Resampling.LANCZOS)
    stream = io.BytesIO()
    small.save(stream, "WEBP", quality=QUALITY, method=2)
    uri = "data:image/webp;base64," + base64.b64encode(stream.getvalue()).decode("ascii")
    return Image(uri, width, round(width * small.height / small.width), alt, caption, stem)


def render(template: str, **facts: Any) -> str:
    """A page of `template`. Texts are escaped; style and script are those of this package, known to the policy by their
    hashes."""
    style, script = (Markup(_text(name)) for name in ("style.css", "viewer.js"))
    return (
        _environment()
        .get_template(template)
        .render(style=style, script=script, style_hash=_hash(style), script_hash=_hash(script), **facts)
    )


@cache
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


@cache
def _text(name: str) -> str:
    return (TEMPLATES / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
