"""The report of a result: tables, figures and HTML pages, each of which needs no other files."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from urllib.parse import quote

from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.result_folder import Result, load
from handbench.reports.figures import plots
from handbench.reports.figures.depth_maps import panels
from handbench.reports.figures.film import film
from handbench.reports.figures.layers import SIGNED
from handbench.reports.figures.pixel_errors import Counts, error_counts, total_counts
from handbench.reports.figures.style import methods
from handbench.reports.page import rendering, scene3d, sections, summary, tradeoff_section
from handbench.reports.page.rendering import Image, render
from handbench.reports.tables import latex, result_tables
from handbench.reports.tables.blocks import blocks, caption
from handbench.support.errors import HandbenchError
from handbench.support.files import write_text
from handbench.support.parallel import script_left_out, workers
from handbench.support.progress import track

ABREAST = 12  # captures on a page
SECTIONS = (
    *("verdicts", "findings", "effects", "uncertainty", "reliability"),
    *("provenance", "command", "settings", "captures"),
)
FIRST = 3  # captures on the first page where there are more
STILL_PX = 272  # height of a capture's picture beside its table


def build(folder: str | Path, out: str | Path) -> Path:
    """Write the report of a result, and return the path of its index.html.

    Args:
        folder: a result folder.
        out: where a result's report is written: index.html, table.md, table.tex, column.tex,
            table.csv, comparisons.*, figures/*.png and *.pdf and, for many captures,
            pages/*.html. Files of an earlier report are replaced, its further pages removed, other
            files left unchanged.

    Raises:
        HandbenchError: `out` is the result folder itself, or drawing would take too long.
    """
    folder, out = Path(folder), Path(out)
    _loaded.cache_clear()  # this process may have written the folder since it last drew it
    result = _loaded(folder)
    if out.resolve() == result.folder.resolve():
        raise HandbenchError(
            f"{out}: is the result folder itself, whose table.csv the report would overwrite; "
            "choose another folder"
        )
    rendering.begin(out)
    texts = {
        "table.md": result_tables.markdown(result),
        "table.tex": latex.latex(result),
        "column.tex": latex.column(result),
        "table.csv": result_tables.csv_text(result),
        "comparisons.md": result_tables.comparisons_markdown(result),
        "comparisons.tex": latex.comparisons(result),
    }
    for name, text in texts.items():
        if text:
            write_text(out / name, text)
    for old in out.glob("pages/[0-9][0-9][0-9]*.html"):
        old.unlink()
    groups = pages(result.scored())
    parts = page_names(groups)
    on_page = {
        c.name: page for page, group in zip(["", *parts], groups, strict=True) for c in group
    }
    facts = _captures(result, groups[0], out / "figures") | {
        "parts": parts,
        "part": 0,
        "groups": groups,
    }
    further = track(
        _drawn(partial(further_page, folder, out, groups), range(1, len(groups))),
        "pages",
        len(parts),
    )
    counts = total_counts([error_counts(result, groups[0]), *further])
    overview = rendering.images(lambda: plots.overview(result, counts), out / "figures")
    write_text(
        out / "index.html",
        render(
            "index.html",
            place_of=lambda name: f"{on_page[name]}#capture-{quote(name)}",
            **_summary(result, overview),
            tradeoff=tradeoff_section.section(result, out / "figures"),
            **facts,
        ),
    )
    return out / "index.html"


def _drawn(page: Callable[[int], Counts], numbers: Sequence[int]) -> Iterator[Counts]:
    """Write the pages with the given numbers, and yield the pixel counts that `page` returns for
    each.
    The pages are written by as many processes as there are cores, because matplotlib must not be
    used in threads."""
    count = min(len(numbers), workers())
    if count < 2:
        yield from map(page, numbers)
        return
    with script_left_out(), ProcessPoolExecutor(count, get_context("spawn")) as processes:
        yield from processes.map(page, numbers)


_loaded = cache(load)  # a process draws many pages of one result


def further_page(
    folder: Path, out: Path, groups: Sequence[Sequence[CaptureFacts]], part: int
) -> Counts:
    """Write one further page of a report, with the captures groups[part] of the result in `folder`,
    and pictures as PNG only.
    Returns the numbers of pixels by size of error of these captures, for the chart of the error
    distribution."""
    result, parts = _loaded(folder), page_names(groups)
    facts = _captures(result, groups[part], out / "figures", paper=False)
    facts |= {"parts": parts, "part": part, "groups": groups}
    write_text(out / parts[part - 1], render("captures.html", about=result.about, **facts))
    return error_counts(result, groups[part])


def page_names(groups: Sequence[Sequence[CaptureFacts]]) -> list[str]:
    """Return the paths, relative to the report, of all pages after the first. There is one page for
    each group of captures."""
    return [f"pages/{i:03d}.html" for i in range(1, len(groups))]


def pages(captures: Sequence[CaptureFacts]) -> list[tuple[CaptureFacts, ...]]:
    """Divide captures over the pages of a report. Returns one tuple of captures for each page.
    All are on the first page if there are at most 12 (ABREAST); otherwise 3 are there (FIRST), and
    up to 12 on each further page."""
    first = len(captures) if len(captures) <= ABREAST else FIRST
    rest = [tuple(captures[i : i + ABREAST]) for i in range(first, len(captures), ABREAST)]
    return [tuple(captures[:first]), *rest]


def _summary(result: Result, overview: list[Image]) -> dict[str, Any]:
    """Return the content of index.html about all captures together: name in the template → value.
    overview: charts of the whole result."""
    parts = {name: getattr(sections, name)(result) for name in SECTIONS}
    parts |= {"about": result.about, "config": result.config, "caption": caption(result)}
    parts |= {"overview": overview}
    parts |= {"leads": summary.leads(result), "main": summary.main_table(result)}
    parts |= {"front": summary.front(result), "hardest": summary.hardest(result)}
    return parts | {"stages": sections.stage_times(result), "blocks": blocks(result)}


def _captures(
    result: Result, captures: Sequence[CaptureFacts], folder: Path, paper: bool = True
) -> dict[str, Any]:
    """Draw the pictures of several captures into `folder`, and return the content of their page:
    name in the template → value, with the pictures and the 3-D view.
    paper: whether PDFs for one column of a paper are written too."""
    titles = {method.name: method.title for method in methods(result)}
    # the paper's own, else the first
    shown = "3fsk" if "3fsk" in titles else next(iter(titles), None)
    details, scenes = [], []
    for capture in captures:
        scene, still = scene3d.scene(result, capture), None
        if scene:
            scenes.append(scene)
            alt = f"Capture {capture.name} seen from the array, lit from the upper left."
            if shown and capture.references:
                alt += f" Colours: the errors of {titles[shown]}; {SIGNED}."
            seen = scene3d.still(result, capture, shown)
            still = rendering.image(seen, alt, alt, shown=STILL_PX / seen.height)
        pictures = rendering.images(partial(panels, result, capture), folder, paper)
        grid, moving = summary.capture_grid(result, capture), _film(result, capture, folder)
        details.append((capture, still, grid, pictures, moving))
    still = next((still for _, still, *_ in details if still), None)
    turned = {"scenes": scenes, "scales": scene3d.scales(), "still": still}
    return turned | {"details": details, "methods": methods(result), "shown": shown}


def _film(result: Result, capture: CaptureFacts, folder: Path) -> Image | None:
    """Draw the film of a capture into `folder`, by the last method that measured velocities of
    several frames; None if there is none."""
    for method in reversed(methods(result)):
        if (frames := result.frames(capture.name, method.name)) is not None:
            title = f"{capture.name}, {method.title}"
            words = f"Capture {capture.name} over its frames by {method.title}: depth, and radial"
            colours = "velocity, red away from the array and blue towards it"
            file = folder / f"film_{capture.name}.gif"
            return rendering.film_image(
                film(frames, title), f"{words} {colours}.", f"{words} {colours}", file
            )
    return None
