"""The report of a result: tables, figures and HTML pages, each of which needs no other files. And
that of several: the report of each, and one page that shows all of their methods."""

from collections.abc import Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from shutil import copyfile
from typing import Any

from handbench.bench.evaluation.metrics import HEADLINE
from handbench.bench.evaluation.tables import each
from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.result_folder import Result, load
from handbench.reports.figures import plots
from handbench.reports.figures.depth_maps import film, panels
from handbench.reports.figures.fronts import ranked_methods
from handbench.reports.figures.layers import SIGNED
from handbench.reports.figures.style import DrawnMethod, methods
from handbench.reports.page import rendering, scene3d, sections, summary
from handbench.reports.page.rendering import Image, render
from handbench.reports.tables.rounding import NONE, figure
from handbench.reports.tables.table import (
    Table,
    against,
    differences,
    every_figure,
    main_lines,
    note,
    of_paper,
    settings,
)
from handbench.reports.tables.writers import COLUMN_PT, latex, markdown
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, free_folder, write_text
from handbench.support.parallel import script_left_out, workers
from handbench.support.progress import track

ABREAST = 12  # captures on a page
FIRST = "index.html"
TITLE = b"handbench report</title>"  # ends so in FIRST
FILES = ("index.html", "pages/*.html", "column.tex", "table.*", "comparisons.*", "figures/*.*")
WRITTEN = (*FILES, *(f"report-[1-9]*/{name}" for name in FILES))  # every file of a report
STILL_PX = 272  # height of a capture's picture beside its table
PICTURES = 3  # captures of a result beside each of its methods, on the page of several results
HEIGHT_PX = 160  # of their pictures


@dataclass(frozen=True)
class Drawn:
    """A capture as its page shows it: its facts, table and pictures; still: how it looks from the
    array; scene: its content of the 3-D view. None for what it does not have."""

    facts: CaptureFacts
    table: Table | None
    pictures: list[Image]
    film: Image | None
    still: Image | None
    scene: dict[str, Any] | None


def build(folder: str | Path, out: str | Path) -> Path:
    """Write the report of a result, and return the path of its index.html.

    Args:
        folder: a result folder.
        out: where a result's report is written: index.html, table.md, table.tex, column.tex,
            table.csv, comparisons.*, figures/*.png and *.pdf and, for many captures,
            pages/*.html. It replaces an earlier report, the whole folder, when it is
            complete.

    Raises:
        HandbenchError: `out` has files that no report wrote.
    """
    result, out = load(folder), Path(out)
    _require_ours(out)
    with atomic_folder(out) as temporary:
        _write(result, temporary)
    return out / FIRST


def _require_ours(out: Path) -> None:
    """Raise a HandbenchError if a folder has a file that no report wrote."""
    free_folder(out, True, WRITTEN)
    index = out / FIRST
    if index.is_file() and TITLE not in index.read_bytes():
        raise HandbenchError(
            f"{index}: no report wrote this file, so its folder is not replaced; choose another "
            "folder, or move the file away"
        )


def _write(result: Result, out: Path) -> None:
    """Write the report of a result into a folder."""
    main, every = summary.main_table(result), every_figure(result)
    compared = not result.comparisons.empty
    tests = [differences(result, main) for main in (True, False) if compared]
    for stem, tables, for_paper in (("table", every, every), ("comparisons", tests, tests[:1])):
        if tables:
            write_text(out / f"{stem}.md", "\n".join(map(markdown, tables)))
            write_text(out / f"{stem}.tex", latex(f"tab:{stem}", *for_paper))
    write_text(
        out / "column.tex", latex("tab:column", of_paper(result) or main, width_pt=COLUMN_PT)
    )
    copyfile(result.folder / "table.csv", out / "table.csv")
    pages = by_page(result.scored())
    shared = {
        "about": result.about,
        "pages": pages,
        "methods": methods(result),
        "shown": main_method(result),
        "scales": scene3d.scales(),
    }
    with closing(_drawn(result, out / "figures")) as captures:
        first = list(islice(captures, len(pages[FIRST])))
        for path in list(pages)[1:]:
            group = list(islice(captures, len(pages[path])))
            write_text(out / path, render("captures.html", path=path, captures=group, **shared))
    write_text(
        out / FIRST,
        render(
            "index.html",
            path=FIRST,
            captures=first,
            leads=summary.leads(result),
            main=main,
            note=note(result),
            every_figure=every,
            overview=rendering.images(lambda: plots.overview(result), out / "figures"),
            settings=[
                settings(result, *ranked, result.about.method_titles)
                for ranked in ranked_methods(result).items()
            ],
            tests=tests,
            details=sections.details(result),
            **shared,
        ),
    )


def build_several(folders: Sequence[Path], out: Path) -> Path:
    """Write the report of each result folder to `out`/report-1, report-2, …, and `out`/index.html
    with a row for each result and method. Returns the path of index.html."""
    results = [load(folder) for folder in folders]
    _require_ours(out)
    with atomic_folder(out) as temporary:
        rows = []
        for number, result in enumerate(results, 1):
            _write(result, temporary / f"report-{number}")
            rows += [(number, result.folder, *_cells(result, method)) for method in methods(result)]
        text = render("several.html", rows=rows, metric=results[0].title(HEADLINE))
        write_text(temporary / FIRST, text)
    return out / FIRST


def _cells(result: Result, method: DrawnMethod) -> tuple[str, str, list[Image]]:
    """Return the title of a method, its mean absolute error and against what, and pictures of the
    result's first captures in the colours of the method's errors."""
    lines = main_lines(result, [HEADLINE])
    line = next(each(lines[lines.method == method.name]), None)
    error = NONE
    if line:  # results may have different references
        value = figure(line.value, line.low, line.high, line.unit)
        error = f"{value} {line.unit} {against(result, line.reference)}"
    pictures = []
    for capture in result.scored()[:PICTURES]:
        picture = scene3d.still(result, capture, method.name)
        alt = f"Errors of {method.title} on capture {capture.name}, seen from the array."
        pictures.append(rendering.image(picture, alt, capture.name, HEIGHT_PX / picture.height))
    return method.title, error, pictures


def by_page(captures: Sequence[CaptureFacts]) -> dict[str, Sequence[CaptureFacts]]:
    """Divide captures over the pages of a report: path relative to the report → up to 12 captures
    (ABREAST)."""
    starts = range(0, max(len(captures), 1), ABREAST)
    return {
        f"pages/{number:03d}.html" if number else FIRST: captures[start : start + ABREAST]
        for number, start in enumerate(starts)
    }


def main_method(result: Result) -> str:
    """Return the method that a page shows first: the paper's own, else the first one; "" without
    methods."""
    names = result.about.method_titles
    return "3fsk" if "3fsk" in names else next(iter(names), "")


def _drawn(result: Result, folder: Path) -> Generator[Drawn, None, None]:
    """Draw the pictures of all captures into `folder`, with PDFs for a paper for those on the first
    page. Yields the captures in their order.
    As many processes as there are cores share them, because matplotlib must not be used in
    threads."""
    captures = result.scored()
    on_first = [number < ABREAST for number in range(len(captures))]
    draw = partial(_draw, result, folder)
    count = min(len(captures), workers())
    if count < 2:
        yield from map(draw, captures, on_first)
        return
    with script_left_out(), ProcessPoolExecutor(count, get_context("spawn")) as processes:
        drawn = processes.map(draw, captures, on_first)
        yield from track(drawn, "drawing", len(captures))


def _draw(result: Result, folder: Path, capture: CaptureFacts, paper: bool) -> Drawn:
    """Draw the pictures of a capture into `folder`.
    paper: whether PDFs for one column of a paper are written too."""
    scene, still = scene3d.scene(result, capture), None
    if scene:
        shown = main_method(result)
        alt = f"Capture {capture.name} seen from the array, lit from the upper left."
        if shown and capture.references:
            alt += f" Colours: the errors of {result.about.method_titles[shown]}; {SIGNED}."
        seen = scene3d.still(result, capture, shown)
        still = rendering.image(seen, alt, alt, shown=STILL_PX / seen.height)
    return Drawn(
        facts=capture,
        table=summary.capture_table(result, capture),
        pictures=rendering.images(partial(panels, result, capture), folder, paper),
        film=_film(result, capture, folder),
        still=still,
        scene=scene,
    )


def _film(result: Result, capture: CaptureFacts, folder: Path) -> Image | None:
    """Draw the film of a capture into `folder`, by the last method that measured velocities of
    several frames; None if there is none."""
    for method in reversed(methods(result)):
        if (frames := result.frames(capture.name, method.name)) is not None:
            text = (
                f"Capture {capture.name} over its frames by {method.title}: depth, and radial "
                "velocity, red away from the array and blue towards it"
            )
            content = film(frames, f"{capture.name}, {method.title}")
            return rendering.film_image(content, text, folder / f"film_{capture.name}.gif")
    return None
