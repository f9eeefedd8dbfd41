"""The report: tables, figures and one self-contained page."""

from __future__ import annotations

import base64
from pathlib import Path

import jinja2

from bench.results import HandbenchError, Result, atomic_path, load
from reports import figures, tables
from reports.style import Picture

TEMPLATES = Path(__file__).parent / "templates"


def build(folder: str | Path, out: str | Path) -> Path:
    """Read the result in `folder`; write table.md, table.tex, table.csv, figures/*.png, *.pdf and index.html to `out`.

    Files of an earlier report are replaced, others are left alone. Returns the path of index.html.
    """
    result, out = load(folder), Path(out)
    if out.resolve() == result.folder.resolve():
        raise HandbenchError(f"{out}: is the result folder itself, whose table.csv must stay; choose another place")
    texts = {"table.md": tables.markdown, "table.tex": tables.latex, "table.csv": tables.csv_text}
    for name, render in texts.items():
        _write(out / name, render(result))
    pictures = figures.save(result, out / "figures")
    _write(out / "index.html", page(result, pictures, out / "figures"))
    return out / "index.html"


def page(result: Result, pictures: list[Picture], folder: Path) -> str:
    """index.html with the PNG files of `pictures`, which lie in `folder`, inside it."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )
    images = [(picture, _data_uri(folder / f"{picture.stem}.png")) for picture in pictures]
    return environment.get_template("report.html").render(
        about=result.about, config=result.config, blocks=tables.blocks(result), caption=tables.caption(result),
        stages=tables.stages(result), images=images,
    )


def _data_uri(png: Path) -> str:
    return "data:image/png;base64," + base64.b64encode(png.read_bytes()).decode("ascii")


def _write(path: Path, text: str) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
