"""The report of several results: the report of each, and one page that shows all of their
methods."""

from collections.abc import Sequence
from pathlib import Path

from handbench.bench.evaluation.metrics import HEADLINE
from handbench.bench.evaluation.tables import each
from handbench.bench.results.result_folder import Result, load
from handbench.reports.figures.style import DrawnMethod, methods
from handbench.reports.page import html, rendering, scene3d
from handbench.reports.tables.rounding import NONE, figure
from handbench.reports.tables.table import main_lines
from handbench.support.files import write_text

PICTURES = 3  # captures in a row
HEIGHT_PX = 160  # of their pictures


def build(folders: Sequence[Path], out: Path) -> Path:
    """Write the report of each result folder to `out`/report-1, report-2, …, and `out`/index.html
    with a row for each result and method. Returns the path of index.html."""
    results = [load(folder) for folder in folders]
    rendering.begin(out)
    rows = []
    for number, result in enumerate(results, 1):
        page = html.build(result.folder, out / f"report-{number}").relative_to(out)
        rows += [(page, result.folder, *_cells(result, method)) for method in methods(result)]
    text = rendering.render("several.html", rows=rows, metric=results[0].title(HEADLINE))
    write_text(out / "index.html", text)
    return out / "index.html"


def _cells(result: Result, method: DrawnMethod) -> tuple[str, str, list[rendering.Image]]:
    """Return the title of a method, its mean absolute error as text, and pictures of the result's
    first captures in the colours of the method's errors."""
    lines = main_lines(result, [HEADLINE])
    line = next(each(lines[lines.method == method.name]), None)
    error = f"{figure(line.value, line.low, line.high, line.unit)} {line.unit}" if line else NONE
    pictures = []
    for capture in result.scored()[:PICTURES]:
        picture = scene3d.still(result, capture, method.name)
        alt = f"Errors of {method.title} on capture {capture.name}, seen from the array."
        shown = HEIGHT_PX / picture.height
        pictures.append(rendering.image(picture, alt, capture.name, shown=shown))
    return method.title, error, pictures
